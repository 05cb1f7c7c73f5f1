"""Where things stand: each scene is a list of placements, so a new layout is new data only.

Scene frame: y up, floor at y = 0, kitchen towards +z, entrance towards -z.
"""

import math

from model import Light, Placement, SceneModel

EAST_RAD, WEST_RAD, NORTH_RAD = -math.pi / 2, math.pi / 2, math.pi  # where a -z front ends up
STAGE = "Stage_v3_sc0_staging"
LIGHTING = "frl_apartment_stage"
P = "frl_apartment_"

LIVING = [
    Placement(f"{P}rug_02", (0.05, 0.006, 1.25)),
    Placement(f"{P}sofa", (-2.05, 0.393, 1.25), EAST_RAD),
    Placement(f"{P}cushion_01", (-2.05, 0.644, 1.93), EAST_RAD + 0.12, 0.22),
    Placement(f"{P}cushion_03", (-2.05, 0.644, 0.57), EAST_RAD - 0.12, 0.22),
    Placement(f"{P}table_03", (-0.20, 0.342, 1.25), math.pi / 2),
    Placement(f"{P}chair_01", (-1.42, 0.362, 3.30), 0.26),
    Placement(f"{P}chair_01", (-0.20, 0.362, 3.28), -0.25),
    Placement(f"{P}table_04", (-2.22, 0.425, 2.66)),
    Placement(f"{P}lamp_02", (-2.22, 0.711, 2.66)),
    Placement(f"{P}tvstand", (4.20, 0.377, 1.25), EAST_RAD + math.pi),
    Placement(f"{P}tv_screen", (4.28, 1.36, 1.25), EAST_RAD + math.pi),
    Placement(f"{P}indoor_plant_02", (4.02, 0.976, 2.50), 2.4),
    Placement(f"{P}indoor_plant_01", (-2.18, 0.509, 3.62)),
    Placement(f"{P}wall_cabinet_02", (0.534, 1.066, -0.498)),
    Placement(f"{P}wall_cabinet_01", (4.10, 1.037, -0.500)),
    Placement(f"{P}book_06", (0.285, 1.5166, -0.46)),
    Placement(f"{P}book_06", (0.785, 1.1993, -0.46)),
    Placement(f"{P}vase_01", (0.72, 2.132, -0.50)),
    Placement(f"{P}picture_02", (1.70, 1.50, -0.6725)),
]
DINING = [
    Placement(f"{P}table_01", (2.75, 0.664, 3.05)),
    Placement(f"{P}chair_04", (2.75, 0.456, 3.58), 0.0),
    Placement(f"{P}chair_04", (3.62, 0.456, 3.05), math.pi / 2),
]
KITCHEN = [
    Placement(f"{P}table_02", (4.05, 0.592, 6.12), -math.pi / 2),
    Placement(f"{P}rug_01", (2.35, 0.008, 6.12)),
    Placement(f"{P}lamp_01", (4.10, 0.85, 7.60)),
    Placement(f"{P}clock", (1.30, 1.85, 7.992), NORTH_RAD),
    Placement(f"{P}picture_02", (2.76, 1.55, 7.992), NORTH_RAD),
    Placement(f"{P}vase_01", (3.35, 0.958, 7.82)),
]
BEDROOM = [
    Placement("apartment_bed", (1.90, 0.312, -3.52), NORTH_RAD),
    Placement(f"{P}rug_01", (1.90, 0.006, -2.75), math.pi / 2),
    Placement(f"{P}table_04", (0.75, 0.425, -4.30)),
    Placement(f"{P}lamp_02", (0.75, 0.711, -4.30)),
    Placement(f"{P}stool_02", (3.08, 0.28, -4.25)),
    Placement(f"{P}beanbag", (3.80, 0.333, -3.95)),
    Placement(f"{P}picture_03", (-0.282, 1.55, -3.60), math.pi / 2),
]
HALL = [
    Placement(f"{P}mat", (-1.48, 0.006, -4.20)),
    Placement(f"{P}picture_01", (-2.48, 1.62, -0.75), math.pi / 2),
]
FURNITURE = [
    Placement("fridge", (0.545, 1.01, 4.40)),
    Placement("kitchen_counter", (0.735, 0.03, 6.374)),
    Placement("kitchenCupboard_01", (0.430, 1.53, 6.374)),
    Placement("door2", (-0.392, 2.08, -2.648)),
    Placement("cabinet", (2.76, 0.05, 7.788), math.pi),
    Placement("chestOfDrawers_01", (-2.335, 0.0, -0.75)),
]
SCENES = [
    SceneModel(
        "v3_sc0_staging_00", STAGE, LIGHTING, LIVING + DINING + KITCHEN + BEDROOM + HALL, FURNITURE
    ),
]
LIGHTINGS = {
    LIGHTING: [
        Light((0.4, 2.45, 1.3), 3.6, (1.0, 0.93, 0.82)),
        Light((2.6, 2.45, 3.1), 2.6, (1.0, 0.90, 0.76)),
        Light((2.2, 2.45, 6.1), 3.6, (1.0, 0.97, 0.92)),
        Light((-1.45, 2.45, -2.6), 2.6, (1.0, 0.93, 0.82)),
        Light((2.0, 2.45, -2.7), 3.0, (0.93, 0.97, 1.0)),
        Light((-1.9, 1.35, 2.6), 0.35, (1.0, 0.80, 0.55)),
    ]
}
