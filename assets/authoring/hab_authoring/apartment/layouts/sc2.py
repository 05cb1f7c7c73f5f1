"""Macro layout 2: kitchen in the north-west, seats in the open south-east, bedroom in the wing."""

import math

from hab_authoring.apartment.layouts.places import (
    RUG_M,
    Item,
    Layout,
    cabinet,
    chest,
    door,
    kitchen,
    lamps,
)
from hab_authoring.apartment.shell import FloorPlan, Opening, Wall, outer_walls

PLAN = FloorPlan(
    "Stage_v3_sc2_staging",
    (
        *outer_walls(
            south=(Opening(2.7, 4.0, 0.8, 2.2, "window"),),
            east=(
                Opening(-3.2, -1.2, 0.6, 2.2, "window"),
                Opening(2.65, 3.65, 0.9, 2.2, "window"),
                Opening(5.2, 6.6, 1.0, 2.2, "window"),
            ),
            paint="wall_blue",
        ),
        # A hall with a built-in wardrobe behind the room door.
        Wall((-0.40, -0.30), (-4.60, -2.70), (), "wall_blue"),
        Wall((-2.10, -2.00), (-4.60, -3.30), (Opening(-4.48, -3.52, 0.0, 2.085, "doorway"),)),
        Wall((-2.50, -2.10), (-3.40, -3.30)),
        # The bedroom.
        Wall((0.225, 4.44), (3.95, 4.05), (Opening(0.65, 1.80, 0.0, 2.12, "doorway"),)),
    ),
    (
        ((-2.66, 4.60), (-4.76, 4.00), "floor_planks"),
        ((-2.66, 0.065), (4.00, 4.11), "floor_planks"),
        ((0.065, 4.60), (4.00, 8.17), "floor_carpet"),
    ),
    (
        ((-2.50, -0.01, -0.80), (-0.60, 0.002, 3.95), "floor_tile", 0.0),
        ((-2.50, 0.85, 0.15), (-2.493, 1.545, 3.30), "wall_tile", 0.0),
    ),
)
LIVING = (
    Item("rug_02", 1.60, -2.66),
    Item("sofa", 1.60, -0.90, "south"),
    Item("cushion_01", 2.28, -0.90, "south", 0.12, y_m=0.644, tilt_rad=0.22),
    Item("cushion_03", 0.92, -0.90, "south", -0.12, y_m=0.644, tilt_rad=0.22),
    Item("table_03", 1.60, -2.62, "south", level_m=RUG_M),
    Item("tvstand", 1.60, -4.22, "north"),
    Item("tv_screen", 1.60, -4.44, "north", y_m=1.36),
    Item("chair_01", 3.86, -2.00, "west", -0.20),
    Item("chair_01", 3.86, -3.10, "west", 0.20),
    Item("beanbag", 0.28, -3.62),
    Item("indoor_plant_02", 4.05, -4.15, turn_rad=0.7),
    Item("table_04", 0.20, -0.85),
    Item("lamp_02", 0.20, -0.85, level_m=0.491),
    Item("picture_01", -0.28, -3.60, "east", y_m=1.62),
)
DINING = (
    Item("table_01", 2.10, 1.45),
    Item("chair_04", 1.75, 0.92, "north"),
    Item("chair_04", 2.45, 0.92, "north"),
    Item("table_02", 2.90, 3.40, "south"),
    Item("vase_01", 4.20, 1.45, level_m=1.982),
    Item("wall_cabinet_02", 4.20, 1.30, "west"),
    Item("wall_cabinet_01", 4.20, 0.25, "west"),
    Item("book_06", 4.16, 1.05, "west", y_m=1.5166),
    Item("picture_02", 2.90, 3.932, "south", y_m=1.60),
    Item("lamp_01", 4.15, 3.60),
)
KITCHEN = (
    Item("mat", -1.30, 2.00, "east", level_m=0.002),
    Item("clock", -1.20, 3.932, "south", y_m=1.85),
    Item("indoor_plant_01", -0.15, 3.55),
)
HALL = (
    Item("bike_02", -2.15, -2.10, "north"),
    Item("clothes_hanger_02", -0.70, -4.25, "north"),
)
BEDROOM = (
    Item("apartment_bed", 2.40, 6.88, "south"),
    Item("rug_01", 2.40, 5.05, "west"),
    Item("table_04", 1.24, 7.68),
    Item("lamp_02", 1.24, 7.68, level_m=0.491),
    Item("stool_02", 4.05, 7.60),
    Item("picture_03", 2.40, 7.992, "south", y_m=1.65),
)
LAYOUT = Layout(
    "v3_sc2_staging_00",
    PLAN,
    "Stage_v3_sc2_staging",
    LIVING + DINING + KITCHEN + HALL + BEDROOM,
    (
        *kitchen(-2.50, -0.24, "east"),
        door(-2.008, -3.547, math.pi),
        cabinet(4.19, 4.95, "west"),
        chest(0.41, 6.30, "east"),
    ),
    lamps(
        (-1.4, 1.7, 3.4), (1.9, 1.6, 3.2), (1.6, -2.4, 3.6), (2.6, 6.2, 3.4), (-1.4, -3.0, 2.8),
        (3.6, -0.6, 1.6),
    ),
)  # fmt: skip
