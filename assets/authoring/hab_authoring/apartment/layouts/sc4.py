"""Macro layout 4: kitchen along the south wall, seats in the wing, bedroom in the north-west."""

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
    "Stage_v3_sc4_staging",
    (
        *outer_walls(
            west=(
                Opening(1.00, 2.20, 1.0, 2.2, "window"),
                Opening(-2.6, -1.2, 1.0, 2.2, "window"),
            ),
            east=(
                Opening(-2.9, -1.1, 0.9, 2.2, "window"),
                Opening(2.2, 3.7, 0.5, 2.2, "window"),
            ),
            north=(Opening(1.5, 3.3, 1.0, 2.2, "window"),),
            north_west=(Opening(-2.1, -0.7, 1.15, 2.2, "window"),),
        ),
        # The hall.
        Wall((-0.40, -0.30), (-4.60, -3.10), (), None, "wall_plum"),
        # The bedroom.
        Wall(
            (-2.50, 0.40),
            (-0.10, 0.00),
            (Opening(-0.90, 0.06, 0.0, 2.085, "doorway"),),
            None,
            "wall_plum",
        ),
        Wall((0.40, 0.50), (-0.10, 3.95), (Opening(0.95, 2.10, 0.0, 2.12, "doorway"),)),
    ),
    (
        ((-2.66, 4.60), (-4.76, 3.95), "floor_pale"),
        ((0.065, 4.60), (3.95, 8.17), "floor_pale"),
        ((-2.66, 0.065), (3.95, 4.11), "floor_pale"),
    ),
    (
        ((0.05, -0.01, -4.60), (4.44, 0.002, -2.60), "floor_slate", 0.0),
        ((-2.50, -0.01, 0.00), (0.40, 0.002, 3.95), "floor_carpet", 0.0),
        ((0.40, 0.85, -4.60), (3.60, 1.545, -4.593), "wall_tile", 0.0),
    ),
)
LIVING = (
    Item("rug_02", 2.58, 5.80, "west"),
    Item("sofa", 0.84, 5.80, "east"),
    Item("cushion_01", 0.84, 6.48, "east", 0.12, y_m=0.644, tilt_rad=0.22),
    Item("cushion_03", 0.84, 5.12, "east", -0.12, y_m=0.644, tilt_rad=0.22),
    Item("table_03", 2.60, 5.80, "west", level_m=RUG_M),
    Item("tvstand", 4.06, 5.80, "west"),
    Item("tv_screen", 4.28, 5.80, "west", y_m=1.36),
    Item("chair_01", 1.28, 7.50, "south", 0.15),
    Item("chair_01", 3.02, 7.50, "south", -0.20),
    Item("beanbag", 3.80, 4.42),
    Item("indoor_plant_02", 4.10, 7.66, turn_rad=0.4),
    Item("lamp_01", 0.52, 7.32),
)
DINING = (
    Item("table_01", 3.05, 1.75, "east"),
    Item("chair_04", 3.57, 1.42, "west"),
    Item("chair_04", 3.57, 2.08, "west"),
    Item("wall_cabinet_02", 0.71, 3.25, "east"),
    Item("wall_cabinet_01", 0.71, 0.25, "east"),
    Item("book_06", 0.74, 3.50, "east", y_m=1.5166),
    Item("picture_02", 0.243, 5.80, "east", y_m=1.60),
)
KITCHEN = (
    Item("table_02", 1.70, -1.35, "north"),
    Item("mat", 2.05, -3.10, "north", level_m=0.002),
    Item("clock", -0.282, -4.10, "east", y_m=1.85),
    Item("indoor_plant_01", 4.10, -2.30),
)
BEDROOM = (
    Item("apartment_bed", -1.55, 2.82, "south"),
    Item("rug_01", -1.55, 1.35, "west"),
    Item("table_04", -0.35, 3.65),
    Item("lamp_02", -0.35, 3.65, level_m=0.491),
    Item("picture_03", 0.382, 2.95, "west", y_m=1.55),
)
HALL = (
    Item("picture_01", -0.418, -3.85, "west", y_m=1.55),
    Item("bike_02", -2.15, -3.55, "north"),
    Item("clothes_hanger_02", -0.68, -3.45, "west"),
)
LAYOUT = Layout(
    "v3_sc4_staging_00",
    PLAN,
    "Stage_v3_sc4_staging",
    LIVING + DINING + KITCHEN + BEDROOM + HALL,
    (
        *kitchen(-4.60, 4.00, "north"),
        door(0.033, -0.092, -math.pi / 2),
        cabinet(4.19, 0.10, "west"),
        chest(-2.33, -2.00, "east"),
    ),
    lamps(
        (2.2, -3.2, 3.4), (2.6, 1.4, 3.4), (2.3, 6.0, 3.6), (-1.2, 1.6, 3.0), (-1.4, -2.6, 3.0),
        (1.4, -0.6, 1.6),
    ),
)  # fmt: skip
