"""Clutter of the densely furnished flats: small objects and their surfaces.

Surfaces are patterns for "template/surface"; "+" joins the templates of a stack, lowest first.
"""

from dataclasses import dataclass

COUNTER = ("kitchen_counter/counter_*",)
DINING = ("table_01/*",)
COFFEE = ("table_03/*",)
BENCH = ("tvstand/*Top1*", "cabinet/*")
SHELVES = ("wall_cabinet_0?/*",)
DESKS = ("table_02/*Top1*", "frl_apartment_cabinet/*")
RACK = ("rack_01/*",)
FLOOR = ("floor/*",)


@dataclass(frozen=True)
class Thing:
    """An object or a stack, its count, and its allowed surfaces."""

    template: str
    places: tuple[str, ...]
    count: int = 1
    turn_rad: float = 0.2  # how far it may be turned from its place's front, to either side


# The largest first: they are placed in this order.
THINGS = (
    # What cooks and what is cooked with
    Thing("plate_02", (*COUNTER, "cabinet/*")),
    Thing("kitchen_utensil_01", COUNTER),
    Thing("choppingboard_02", (*COUNTER, "cabinet/*"), 2),
    Thing("small_appliance_01", COUNTER),
    Thing("pan_01", COUNTER),
    Thing("kitchen_utensil_04", COUNTER, turn_rad=0.0),
    Thing("small_appliance_02", COUNTER),
    Thing("knifeblock", COUNTER),
    Thing("bowl_06", (*COUNTER, *SHELVES)),
    Thing("kitchen_utensil_08", COUNTER),
    Thing("sponge_dish", COUNTER),
    Thing("kitchen_utensil_06", COUNTER),
    Thing("kitchen_utensil_02", COUNTER),
    Thing("kitchen_utensil_09", (*COUNTER, *DINING)),
    Thing("kitchen_utensil_03", ("kitchen_utensil_04/*",), 5, turn_rad=0.0),
    # The dining table
    Thing("bowl_07", DINING),
    Thing("plate_01", DINING, 2),
    Thing("bowl_01", (*DINING, "table_02/*Top2*")),
    Thing("cup_03", DINING),
    Thing("cup_05", DINING),
    Thing("cup_01", (*DINING, *DESKS)),
    # The living room
    Thing("kitchen_utensil_05", COFFEE),
    Thing("book_05+book_01+book_04", COFFEE),
    Thing("cup_02", (*COFFEE, *DESKS)),
    Thing("remote-control_01", (*COFFEE, *BENCH[:1]), 2),
    Thing("setupbox", ("tvstand/*Top2*", "tvstand/*Top3*"), turn_rad=0.05),
    Thing("tv_object", ("tvstand/*Top2*", "tvstand/*Top3*"), turn_rad=0.05),
    Thing("picture_04", (*BENCH, *SHELVES), 2),
    Thing("vase_02", (*BENCH, *DESKS)),
    Thing("camera_02", (*BENCH, *SHELVES)),
    Thing("cushion_03", ("sofa/end_*",), 2, turn_rad=0.0),
    Thing("cushion_01", ("sofa/back",), turn_rad=0.0),
    Thing("cloth_03", ("sofa/Sofa*", "chair_01/*", "stool_02/*")),
    # The shelves
    Thing("book_06", SHELVES, 2, turn_rad=0.0),
    Thing("box", (*FLOOR, "table_02/*Top3*"), 2, turn_rad=0.05),
    Thing("vase_01", ("chestOfDrawers_01/*", "cabinet/*")),
    Thing("bowl_02", (*SHELVES, "table_02/*Top2*")),
    Thing("bowl_03", (*SHELVES, "table_02/*Top2*")),
    Thing("book_05+book_02", (*SHELVES, *DESKS)),
    Thing("book_02+book_01+book_03", (*SHELVES, "table_04/*")),
    Thing("book_01+book_03", SHELVES),
    Thing("book_04", (*SHELVES, *DESKS, "stool_02/*")),
    # The desk
    Thing("monitor_stand+monitor", DESKS, turn_rad=0.05),
    # Bedroom and hall
    Thing("cushion_03", ("apartment_bed/cover",), turn_rad=0.0),
    Thing("cloth_04", ("apartment_bed/cover", "chair_01/*")),
    Thing("towel", ("apartment_bed/cover", "cabinet/*", "chestOfDrawers_01/*")),
    Thing("clothes_hanger_01", ("apartment_bed/cover", "frl_apartment_cabinet/*"), 2, turn_rad=1.0),
    Thing("handbag", (*FLOOR, "apartment_bed/cover")),
    Thing("shoe_01", RACK, turn_rad=0.02),
    Thing("shoe_02", RACK, turn_rad=0.02),
    Thing("shoe_03", RACK, turn_rad=0.02),
    Thing("shoe_04", RACK, turn_rad=0.02),
    Thing("shoebox_01", (*RACK, "chestOfDrawers_01/*"), turn_rad=0.02),
)
