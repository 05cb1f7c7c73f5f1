"""The apartment's hundred micro-variations: all there, each what `hab-tasks vary` makes."""

import pytest

from hab_tasks.scenes.dataset import SPLIT_MACROS, resolve_dataset
from hab_tasks.scenes.fields import read_json
from hab_tasks.scenes.layout_checks import check_layout
from hab_tasks.scenes.vary import LayoutVarier

APARTMENT = resolve_dataset("apartment")
MACROS = [f"sc{number}" for number in range(5)]
SEED = 0


def scene(macro: str, number: int) -> dict:
    return read_json(APARTMENT.scene_file(f"v3_{macro}_staging_{number:02d}"))


def instances(data: dict) -> list[dict]:
    return [*data["object_instances"], *data["articulated_object_instances"]]


def test_all_layouts_are_there():
    # 5 macro layouts, 20 micro-variations of each, 6 dense flats: 5 + 100 + 6 = 111 (S A.2).
    assert len(APARTMENT.scene_files) == 111
    counts = {split: len(APARTMENT.scenes_of_split(split)) for split in SPLIT_MACROS}
    assert counts == {"train": 63, "val": 21, "test": 21}
    assert sum(name.startswith("apt_") for name in APARTMENT.scene_files) == 6


@pytest.mark.parametrize("macro", MACROS)
def test_variations_hold_the_same_pieces_in_other_places(macro):
    """At least two pieces swapped and one perturbed (S A.1): at least three have moved."""
    first = instances(scene(macro, 0))
    seen = set()
    for number in range(1, 21):
        pieces = instances(scene(macro, number))
        assert [p["template_name"] for p in pieces] == [p["template_name"] for p in first]
        moved = [
            a["template_name"]
            for a, b in zip(first, pieces, strict=True)
            if (a["translation"], a["rotation"]) != (b["translation"], b["rotation"])
        ]
        assert len(moved) >= 3
        kitchen = ("fridge", "kitchen_counter", "kitchenCupboard_01", "door2")
        assert not set(kitchen) & set(moved)
        seen.add(repr([p["translation"] for p in pieces]))
    assert len(seen) == 20


@pytest.mark.slow
@pytest.mark.parametrize("macro", MACROS)
def test_variations_are_what_the_command_makes(macro):
    varier = LayoutVarier(APARTMENT, macro)
    for number in (1, 10, 20):
        assert varier.make(SEED, number).scene == scene(macro, number), number


@pytest.mark.slow
@pytest.mark.parametrize("macro", MACROS)
def test_nothing_is_wrong_with_any(macro):
    for number in range(21):
        report = check_layout(APARTMENT, f"v3_{macro}_staging_{number:02d}")
        assert not report.reasons
