"""YCB objects of the tasks: training and held-out sets (S E.1), categories."""

from __future__ import annotations

TRAIN_OBJECTS = (
    "002_master_chef_can",
    "003_cracker_box",
    "004_sugar_box",
    "005_tomato_soup_can",
    "007_tuna_fish_can",
    "008_pudding_box",
    "009_gelatin_box",
    "010_potted_meat_can",
    "024_bowl",
)
"""Objects seen in training (S E.1)."""

UNSEEN_OBJECTS = ("013_apple", "017_orange", "025_mug", "026_sponge")
"""Objects held out for evaluation (S E.1)."""

ALL_OBJECTS = tuple(sorted(TRAIN_OBJECTS + UNSEEN_OBJECTS))

CATEGORIES: dict[str, tuple[str, ...]] = {
    "can": tuple(name for name in ALL_OBJECTS if name.endswith("_can")),
    "box": tuple(name for name in ALL_OBJECTS if name.endswith("_box")),
    "fruit": ("013_apple", "017_orange"),
    "dish": ("024_bowl", "025_mug"),
}
"""Category -> its objects."""
