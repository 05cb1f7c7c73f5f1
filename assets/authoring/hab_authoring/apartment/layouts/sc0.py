"""Macro layout 0: kitchen in the north wing, seats along the west wall, bedroom south-east."""

from hab_authoring.apartment.layouts.places import (
    RUG_M,
    Item,
    Layout,
    cabinet,
    chest,
    door,
    kitchen,
)
from hab_authoring.apartment.model import Light
from hab_authoring.apartment.shell import FloorPlan, Opening, Wall, outer_walls

PLAN = FloorPlan(
    "Stage_v3_sc0_staging",
    (
        *outer_walls(
            west=(Opening(0.35, 2.15, 1.0, 2.2, "window"),),
            south=(Opening(0.9, 2.9, 0.8, 2.2, "window"),),
            east=(
                Opening(-3.5, -2.0, 0.8, 2.2, "window"),
                Opening(2.65, 3.75, 0.5, 2.2, "window"),
                Opening(5.2, 7.0, 1.15, 2.2, "window"),
            ),
            north_west=(Opening(-2.0, -0.5, 0.9, 2.2, "window"),),
            paint="wall_sage",
        ),
        Wall((0.225, 0.85), (3.95, 4.03)),
        Wall((-0.40, 4.44), (-0.79, -0.69), (Opening(2.55, 3.65, 0.0, 2.12, "doorway"),)),
        Wall((-0.40, -0.30), (-4.60, -0.79), (Opening(-2.675, -1.715, 0.0, 2.085, "doorway"),)),
    ),
    (
        ((-2.66, 4.60), (-4.76, 4.03), "floor_planks"),
        ((0.065, 4.60), (4.03, 8.17), "floor_tile"),
    ),
    (
        ((0.225, -0.01, 4.02), (4.44, 0.002, 4.04), "trim", 0.001),
        ((0.225, 0.85, 4.80), (0.232, 1.545, 8.01), "wall_tile", 0.0),
    ),
)
LIVING = (
    Item("rug_02", 0.05, 1.25),
    Item("sofa", -2.05, 1.25, "east"),
    Item("cushion_01", -2.05, 1.93, "east", 0.12, y_m=0.644, tilt_rad=0.22),
    Item("cushion_03", -2.05, 0.57, "east", -0.12, y_m=0.644, tilt_rad=0.22),
    Item("table_03", -0.20, 1.25, "west", level_m=RUG_M),
    Item("chair_01", -1.42, 3.30, "south", 0.26),
    Item("chair_01", -0.20, 3.28, "south", -0.25),
    Item("table_04", -2.22, 2.66),
    Item("lamp_02", -2.22, 2.66, level_m=0.491),
    Item("tvstand", 4.20, 1.25, "west"),
    Item("tv_screen", 4.28, 1.25, "west", y_m=1.36),
    Item("indoor_plant_02", 4.02, 2.50, turn_rad=2.4),
    Item("indoor_plant_01", -2.18, 3.62),
    Item("wall_cabinet_02", 0.534, -0.498, "north"),
    Item("wall_cabinet_01", 4.10, -0.500, "north"),
    Item("book_06", 0.285, -0.46, y_m=1.5166),
    Item("book_06", 0.785, -0.46, y_m=1.1993),
    Item("vase_01", 0.72, -0.50, level_m=1.982),
    Item("picture_02", 1.70, -0.6725, "north", y_m=1.50),
)
DINING = (
    Item("table_01", 2.75, 3.05),
    Item("chair_04", 2.75, 3.58, "south"),
    Item("chair_04", 3.62, 3.05, "west"),
)
KITCHEN = (
    Item("table_02", 4.05, 6.12, "east"),
    Item("rug_01", 2.35, 6.12, level_m=0.002),
    Item("lamp_01", 4.12, 5.15),
    Item("clock", 1.30, 7.992, "south", y_m=1.85),
    Item("picture_02", 3.12, 7.992, "south", y_m=1.55),
    Item("vase_01", 3.65, 7.82, level_m=0.808),
)
BEDROOM = (
    Item("apartment_bed", 1.90, -3.52, "north", level_m=RUG_M),
    Item("rug_01", 1.90, -2.75, "west"),
    Item("table_04", 0.75, -4.30),
    Item("lamp_02", 0.75, -4.30, level_m=0.491),
    Item("stool_02", 3.08, -4.25),
    Item("beanbag", 3.80, -3.95),
    Item("picture_03", -0.282, -3.60, "east", y_m=1.55),
)
HALL = (
    Item("mat", -1.48, -4.20),
    Item("bike_02", -2.15, -2.60, "north"),
    Item("clothes_hanger_02", -2.22, -3.95, "east"),
    Item("picture_01", -2.48, -0.75, "east", y_m=1.62),
)
LAYOUT = Layout(
    "v3_sc0_staging_00",
    PLAN,
    "frl_apartment_stage",
    LIVING + DINING + KITCHEN + BEDROOM + HALL,
    (
        *kitchen(0.225, 4.40, "east"),
        door(-0.392, -2.648),
        cabinet(3.12, 7.788, "south"),
        chest(-2.335, -0.75, "east"),
    ),
    (
        Light((0.4, 2.45, 1.3), 3.6, (1.0, 0.93, 0.82)),
        Light((2.6, 2.45, 3.1), 2.6, (1.0, 0.90, 0.76)),
        Light((2.2, 2.45, 6.1), 3.6, (1.0, 0.97, 0.92)),
        Light((-1.45, 2.45, -2.6), 2.6, (1.0, 0.93, 0.82)),
        Light((2.0, 2.45, -2.7), 3.0, (0.93, 0.97, 1.0)),
        Light((-1.9, 1.35, 2.6), 0.35, (1.0, 0.80, 0.55)),
    ),
)
