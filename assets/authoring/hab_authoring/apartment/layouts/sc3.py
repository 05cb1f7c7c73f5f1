"""Macro layout 3: kitchen along the east wall, seats in the north-west, dining in the wing."""

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
    "Stage_v3_sc3_staging",
    (
        *outer_walls(
            west=(
                Opening(0.90, 2.70, 0.8, 2.2, "window"),
                Opening(-3.9, -2.7, 1.4, 2.2, "window"),
            ),
            south=(Opening(1.2, 2.4, 0.9, 2.2, "window"),),
            east=(
                Opening(-3.7, -2.3, 0.9, 2.2, "window"),
                Opening(5.1, 7.1, 0.6, 2.2, "window"),
            ),
            north=(Opening(1.3, 2.5, 1.0, 2.2, "window"),),
            paint="wall_ochre",
        ),
        # The wall behind the television, and the bedroom.
        Wall((-2.50, -0.50), (-1.25, -1.15), (), "wall_ochre"),
        Wall((0.75, 4.44), (-1.45, -1.35), (Opening(1.25, 2.40, 0.0, 2.12, "doorway"),)),
        Wall((0.65, 0.75), (-4.60, -1.35), (Opening(-2.675, -1.715, 0.0, 2.085, "doorway"),)),
    ),
    (
        ((-2.66, 4.60), (-4.76, 3.95), "floor_dark"),
        ((0.065, 4.60), (3.95, 8.17), "floor_dark"),
        ((-2.66, 0.065), (3.95, 4.11), "floor_dark"),
    ),
    (
        ((2.45, -0.01, -0.50), (4.44, 0.002, 4.00), "floor_tile", 0.0),
        ((0.75, -0.01, -4.60), (4.44, 0.002, -1.45), "floor_carpet", 0.0),
        ((4.433, 0.85, -0.20), (4.44, 1.545, 3.00), "wall_tile", 0.0),
    ),
)
LIVING = (
    Item("rug_02", -1.00, 1.70),
    Item("sofa", -1.00, 3.32, "south"),
    Item("cushion_01", -0.32, 3.32, "south", 0.12, y_m=0.644, tilt_rad=0.22),
    Item("cushion_03", -1.68, 3.32, "south", -0.12, y_m=0.644, tilt_rad=0.22),
    Item("table_03", -1.00, 1.45, "south", level_m=RUG_M),
    Item("tvstand", -1.20, -0.80, "north"),
    Item("tv_screen", -1.20, -0.985, "north", y_m=1.36),
    Item("chair_01", 0.90, 1.90, "west", -0.25),
    Item("chair_01", 0.90, 0.80, "west", 0.20),
    Item("indoor_plant_01", -2.22, -0.10),
    Item("lamp_01", -2.22, 3.62),
    Item("picture_02", -1.00, 3.932, "south", y_m=1.60),
)
DINING = (
    Item("rug_01", 2.60, 6.20, "west"),
    Item("table_01", 2.60, 6.20, level_m=RUG_M),
    Item("chair_04", 2.25, 6.73, "south"),
    Item("chair_04", 2.95, 6.73, "south"),
    Item("wall_cabinet_02", 0.46, 6.90, "east"),
    Item("wall_cabinet_01", 0.46, 5.90, "east"),
    Item("book_06", 0.49, 7.15, "east", y_m=1.5166),
    Item("beanbag", 0.90, 4.75),
    Item("indoor_plant_02", 4.00, 7.55, turn_rad=1.9),
    Item("clock", 3.50, 7.992, "south", y_m=1.85),
)
KITCHEN = (Item("mat", 3.20, 1.00, "east", level_m=0.002),)
BEDROOM = (
    Item("apartment_bed", 3.24, -3.40, "west"),
    Item("table_04", 4.10, -2.25),
    Item("lamp_02", 4.10, -2.25, level_m=0.491),
    Item("picture_03", 0.768, -4.00, "east", y_m=1.55),
    Item("stool_02", 1.10, -4.20),
    Item("clothes_hanger_02", 4.12, -1.72, "west"),
)
HALL = (
    Item("table_02", -1.95, -2.45, "east"),
    Item("vase_01", -2.35, -4.15, level_m=1.255),
    Item("picture_01", 0.632, -3.60, "west", y_m=1.60),
    Item("bike_01", -0.24, -4.25, "east"),
)
LAYOUT = Layout(
    "v3_sc3_staging_00",
    PLAN,
    "Stage_v3_sc3_staging",
    LIVING + DINING + KITCHEN + BEDROOM + HALL,
    (
        *kitchen(4.44, 3.40, "west"),
        door(0.658, -2.648),
        cabinet(2.70, 7.76, "south"),
        chest(-2.33, -4.12, "east"),
    ),
    lamps(
        (-1.0, 1.6, 3.4), (3.2, 1.6, 3.4), (2.4, 6.1, 3.6), (-1.0, -3.0, 3.0), (2.6, -3.0, 2.8),
        (1.2, -0.4, 1.6),
    ),
)  # fmt: skip
