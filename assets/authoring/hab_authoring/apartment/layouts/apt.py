"""The densely furnished flats: six combinations of two or three arrangements of each room.

Furniture is loose; wall-mounted items and rugs are fixed. `clutter` fills the surfaces.
"""

from dataclasses import replace

from hab_authoring.apartment.layouts import sc0
from hab_authoring.apartment.layouts.places import Item, Layout, cabinet, chest, door, kitchen

PLAN = replace(
    sc0.PLAN,
    name="frl_apartment_stage",
    floors=(
        ((-2.66, 4.60), (-4.76, 4.03), "floor_pale"),
        ((0.065, 4.60), (4.03, 8.17), "floor_slate"),
    ),
)
RUG_M = 0.010  # the height of a rug's collision shape, which carries what is loose
LAMP_M = 0.492  # a lamp's foot on a table_04

SOFA_WEST = (
    Item("rug_02", 0.05, 1.25),
    Item("sofa", -2.03, 1.25, "east"),
    Item("table_03", -0.20, 1.25, "west", level_m=RUG_M),
    Item("chair_01", -1.42, 3.30, "south", 0.26),
    Item("chair_01", -0.20, 3.28, "south", -0.25),
    Item("table_04", -2.22, 2.64),
    Item("lamp_01", 4.12, 0.22),
    Item("tvstand", 4.18, 1.25, "west"),
    Item("tv_screen", 4.28, 1.25, "west", y_m=1.36),
    Item("indoor_plant_02", 4.05, 2.35, turn_rad=2.4),
    Item("indoor_plant_01", -2.18, 3.62),
    Item("wall_cabinet_02", 0.53, -0.496, "north"),
    Item("wall_cabinet_03", 1.62, -0.515, "north"),
    Item("wall_cabinet_01", 4.10, -0.498, "north"),
    Item("picture_02", 1.62, -0.6725, "north", y_m=1.70),
    Item("table_01", 2.75, 3.05),
    Item("chair_04", 2.43, 3.58, "south"),
    Item("chair_04", 3.07, 3.58, "south"),
    Item("chair_05", 2.40, 2.28, "north"),
    Item("chair_05", 3.10, 2.26, "north", 0.15),
)
SOFA_NORTH = (
    Item("rug_02", 0.80, 1.25),
    Item("sofa", 0.80, 3.05, "south"),
    Item("table_03", 0.80, 1.20, "south", level_m=RUG_M),
    Item("chair_01", 2.95, 1.80, "west", 0.10),
    Item("chair_01", 2.95, 0.90, "west", -0.20),
    Item("table_04", -0.56, 3.30),
    Item("lamp_01", -2.26, 0.28),
    Item("tvstand", 0.74, -0.40, "north"),
    Item("tv_screen", 0.74, -0.525, "north", y_m=1.36),
    Item("indoor_plant_02", 3.95, 3.00, turn_rad=0.8),
    Item("indoor_plant_01", -2.15, 3.58),
    Item("wall_cabinet_02", 1.99, -0.496, "north"),
    Item("wall_cabinet_03", 4.24, 1.65, "west"),
    Item("wall_cabinet_01", 4.10, -0.498, "north"),
    Item("picture_02", 4.4215, 1.65, "west", y_m=1.70),
    Item("table_01", -1.70, 1.50, "east"),
    Item("chair_04", -1.17, 1.20, "west"),
    Item("chair_04", -1.17, 1.80, "west"),
    Item("chair_05", -1.70, 2.55, "south"),
    Item("chair_05", -1.70, 0.45, "north", 0.10),
)
SOFA_EAST = (
    Item("rug_02", -0.62, 2.55, "west"),
    Item("sofa", 1.16, 2.55, "west"),
    Item("table_03", -0.60, 2.55, "west", level_m=RUG_M),
    Item("chair_01", -0.56, 0.74, "north", 0.15),
    Item("chair_01", -1.92, 0.74, "north", -0.20),
    Item("table_04", 1.15, 1.18),
    Item("lamp_01", -2.26, 1.91),
    Item("tvstand", -2.24, 2.90, "east"),
    Item("tv_screen", -2.34, 2.90, "east", y_m=1.36),
    Item("indoor_plant_02", 4.00, 3.05, turn_rad=1.5),
    Item("indoor_plant_01", 4.12, 0.15),
    Item("wall_cabinet_02", 0.76, -0.496, "north"),
    Item("wall_cabinet_03", 1.80, -0.515, "north"),
    Item("wall_cabinet_01", 4.10, -0.498, "north"),
    Item("picture_02", 1.80, -0.6725, "north", y_m=1.70),
    Item("table_01", 3.20, 1.30, "east"),
    Item("chair_04", 2.67, 1.00, "east"),
    Item("chair_04", 2.67, 1.60, "east"),
    Item("chair_05", 3.97, 0.95, "west"),
    Item("chair_05", 3.97, 1.65, "west", 0.12),
)

CONSOLE = (
    Item("table_02", 3.96, 6.12, "west"),
    Item("rug_01", 2.30, 6.12),
    Item("stool_02", 3.36, 5.75),
    Item("stool_02", 3.36, 6.45),
    Item("bin_01", 4.23, 7.70, "west"),
    Item("bin_02", 4.24, 4.60, "west"),
    Item("clock", 1.30, 7.992, "south", y_m=1.85),
    Item("picture_01", 3.12, 7.992, "south", y_m=1.50),
)
ISLAND = (
    Item("table_02", 2.75, 6.35, "west"),
    Item("rug_01", 2.90, 4.72, "west"),
    Item("stool_02", 3.50, 6.05),
    Item("stool_02", 3.50, 6.75),
    Item("bin_01", 3.20, 7.78, "south"),
    Item("bin_02", 4.10, 7.80, "south"),
    Item("clock", 1.60, 7.992, "south", y_m=1.85),
    Item("picture_01", 3.30, 7.992, "south", y_m=1.50),
)

BED_SOUTH = (
    Item("apartment_bed", 1.90, -3.50, "north"),
    Item("rug_01", 1.90, -1.60, "west"),
    Item("table_04", 0.75, -4.28),
    Item("beanbag", 3.80, -3.95),
    Item("basket", 4.18, -3.05),
    Item("frl_apartment_cabinet", -0.07, -3.70, "east"),
    Item("lamp_02", 0.75, -4.28, level_m=LAMP_M),
    Item("picture_03", -0.282, -3.70, "east", y_m=1.55),
)
BED_EAST = (
    Item("apartment_bed", 3.34, -2.55, "west"),
    Item("rug_01", 1.50, -2.75),
    Item("table_04", 4.12, -3.72),
    Item("beanbag", 0.26, -4.08),
    Item("basket", 4.15, -4.32),
    Item("frl_apartment_cabinet", 1.70, -4.37, "north"),
    Item("lamp_02", 4.12, -3.72, level_m=LAMP_M),
    Item("picture_03", 1.40, -0.808, "south", y_m=1.55),
)

HALL_BIKES_WEST = (
    Item("mat", -1.48, -4.20),
    Item("bike_02", -2.19, -2.30, "north"),
    Item("bike_01", -1.60, -2.40, "north"),
    Item("rack_01", -2.32, -3.85, "east"),
    Item("umbrella", -2.06, -3.85, "east"),
    Item("clothes_hanger_02", -0.72, -4.30, "north"),
    Item("bin_03", -0.66, -3.62, "west"),
    Item("cloth_01", -0.482, -3.62, "west", y_m=1.55),
    Item("cloth_02", -2.470, -3.85, "east", y_m=1.55),
)
HALL_BIKES_EAST = (
    Item("mat", -1.48, -4.20),
    Item("bike_02", -2.15, -3.55, "north"),
    Item("bike_01", -2.15, -1.55, "north"),
    Item("rack_01", -0.58, -3.69, "west"),
    Item("umbrella", -0.87, -3.60, "east"),
    Item("clothes_hanger_02", -0.70, -1.05, "west"),
    Item("bin_03", -0.68, -4.36, "north"),
    Item("cloth_01", -2.418, -2.50, "east", y_m=1.60),
    Item("cloth_02", -0.430, -3.75, "west", y_m=1.50),
)


def _layout(
    number: int,
    living: tuple[Item, ...],
    cooking: tuple[Item, ...],
    bedroom: tuple[Item, ...],
    hall: tuple[Item, ...],
) -> Layout:
    stored = (
        cabinet(3.12, 7.788, "south") if cooking is CONSOLE else cabinet(4.20, 6.35, "west"),
        chest(-2.335, -0.75, "east") if hall is HALL_BIKES_WEST else chest(0.20, -0.985, "south"),
    )
    return Layout(
        f"apt_{number}",
        PLAN,
        "frl_apartment_stage",
        living + cooking + bedroom + hall,
        (*kitchen(0.225, 4.40, "east"), door(-0.392, -2.648), *stored),
        sc0.LAYOUT.lights,
    )


LAYOUTS = (
    _layout(0, SOFA_WEST, CONSOLE, BED_SOUTH, HALL_BIKES_WEST),
    _layout(1, SOFA_NORTH, ISLAND, BED_EAST, HALL_BIKES_WEST),
    _layout(2, SOFA_EAST, CONSOLE, BED_SOUTH, HALL_BIKES_EAST),
    _layout(3, SOFA_WEST, ISLAND, BED_EAST, HALL_BIKES_EAST),
    _layout(4, SOFA_NORTH, CONSOLE, BED_SOUTH, HALL_BIKES_EAST),
    _layout(5, SOFA_EAST, ISLAND, BED_EAST, HALL_BIKES_WEST),
)
