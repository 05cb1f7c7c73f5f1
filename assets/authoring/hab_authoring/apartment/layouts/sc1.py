"""Macro layout 1: kitchen along the west wall, seats in the north wing, bedroom south-east."""

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
    "Stage_v3_sc1_staging",
    (
        *outer_walls(
            south=(Opening(0.9, 2.9, 0.8, 2.2, "window"),),
            east=(
                Opening(-3.8, -2.0, 0.95, 2.2, "window"),
                Opening(2.45, 3.75, 0.5, 2.2, "window"),
                Opening(5.2, 7.0, 1.15, 2.2, "window"),
            ),
            north_west=(Opening(-2.0, -0.5, 0.9, 2.2, "window"),),
            paint="wall_clay",
        ),
        Wall((-0.40, 4.44), (-1.10, -1.00), (Opening(0.15, 1.30, 0.0, 2.12, "doorway"),)),
        Wall((-0.40, -0.30), (-4.60, -1.10), (Opening(-2.675, -1.715, 0.0, 2.085, "doorway"),)),
    ),
    (
        ((-2.66, 4.60), (-4.76, 3.95), "floor_pale"),
        ((0.065, 4.60), (3.95, 8.17), "floor_pale"),
        ((-2.66, 0.065), (3.95, 4.11), "floor_pale"),
    ),
    (
        ((-2.50, -0.01, -1.45), (-0.55, 0.002, 2.60), "floor_slate", 0.0),
        ((-2.50, 0.85, -0.65), (-2.493, 1.545, 2.50), "wall_tile", 0.0),
    ),
)
LIVING = (
    Item("rug_02", 2.05, 5.75, "west"),
    Item("sofa", 3.88, 5.75, "west"),
    Item("cushion_01", 3.88, 6.43, "west", 0.12, y_m=0.644, tilt_rad=0.22),
    Item("cushion_03", 3.88, 5.07, "west", -0.12, y_m=0.644, tilt_rad=0.22),
    Item("table_03", 2.02, 5.75, "west", level_m=RUG_M),
    Item("tvstand", 0.58, 5.75, "east"),
    Item("tv_screen", 0.385, 5.75, "east", y_m=1.36),
    Item("chair_01", 1.36, 7.52, "south", -0.12),
    Item("chair_01", 2.34, 7.52, "south", 0.22),
    Item("beanbag", 0.90, 4.36),
    Item("indoor_plant_02", 4.02, 7.60, turn_rad=1.1),
    Item("picture_02", 1.85, 7.992, "south", y_m=1.55),
)
DINING = (
    Item("table_01", 1.10, 1.95, "east"),
    Item("chair_04", 0.58, 1.62, "east"),
    Item("chair_04", 0.58, 2.28, "east"),
    Item("table_02", 3.86, 1.25, "west"),
    Item("lamp_01", 4.12, 2.35),
    Item("wall_cabinet_02", 2.30, -0.80, "north"),
    Item("wall_cabinet_01", 3.30, -0.80, "north"),
    Item("book_06", 2.05, -0.76, y_m=1.5166),
    Item("vase_01", 2.50, -0.80, level_m=1.982),
    Item("clock", 1.65, -0.98, "north", y_m=1.85),
)
KITCHEN = (
    Item("mat", -1.30, 1.25, "east", level_m=0.002),
    Item("indoor_plant_01", -0.15, 3.55),
)
BEDROOM = (
    Item("apartment_bed", 3.24, -2.90, "west", level_m=RUG_M),
    Item("rug_01", 2.10, -2.90, "south"),
    Item("table_04", 4.10, -1.80),
    Item("lamp_02", 4.10, -1.80, level_m=0.491),
    Item("stool_02", 4.20, -3.96),
    Item("beanbag", 0.42, -3.90),
    Item("picture_03", 2.60, -1.118, "south", y_m=1.55),
)
HALL = (
    Item("picture_01", -0.418, -3.70, "west", y_m=1.55),
    Item("bike_01", -2.15, -3.10, "north"),
    Item("clothes_hanger_02", -0.68, -4.32, "north"),
)
LAYOUT = Layout(
    "v3_sc1_staging_00",
    PLAN,
    "Stage_v3_sc1_staging",
    LIVING + DINING + KITCHEN + BEDROOM + HALL,
    (
        *kitchen(-2.50, -1.04, "east"),
        door(-0.392, -2.648),
        cabinet(-1.30, 3.70, "south"),
        chest(3.42, -4.43, "north"),
    ),
    lamps(
        (-1.4, 0.9, 3.4), (1.6, 1.9, 3.0), (3.2, 1.0, 2.4), (2.2, 6.1, 3.6), (-1.45, -2.9, 2.8),
        (2.2, -2.9, 3.0),
    ),
)  # fmt: skip
