"""Semantic classes, with ReplicaCAD's names and ids, so that labels agree in both datasets."""

CLASSES = {
    "basket": 3,
    "beanbag": 6,
    "bed": 7,
    "bike": 9,
    "bin": 10,
    "book": 13,
    "box": 15,
    "bowl": 16,
    "camera": 17,
    "cabinet": 18,
    "chair": 20,
    "chopping_board": 21,
    "clock": 22,
    "cloth": 23,
    "cup": 28,
    "cushion": 29,
    "handbag": 41,
    "indoor_plant": 44,
    "knife_block": 45,
    "kitchen_utensil": 46,
    "lamp": 47,
    "mat": 50,
    "monitor": 52,
    "pan": 55,
    "picture": 59,
    "plate": 64,
    "rack": 66,
    "refrigerator": 67,
    "remote_control": 68,
    "shoe": 72,
    "small_appliance": 75,
    "sofa": 76,
    "stool": 78,
    "table": 80,
    "tablet": 82,
    "towel": 86,
    "tv_screen": 87,
    "tv_stand": 88,
    "umbrella": 89,
    "vase": 91,
    "wall_cabinet": 94,
    "rug": 98,
    # ReplicaCAD labels hangers as chopping boards; here they have an id after its last one.
    "clothes_hanger": 102,
}


def of(categories: set[str]) -> dict[str, list[dict[str, str | int]]]:
    """Return Habitat's lexicon of the classes among `categories`, by id."""
    return {"classes": [{"name": n, "id": k} for n, k in CLASSES.items() if n in categories]}
