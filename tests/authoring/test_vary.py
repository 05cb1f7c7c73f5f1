"""Micro-variations: their rules, unchanged parts, and independent checks."""

import copy
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hab_authoring.layouts.checks import check_layout
from hab_authoring.layouts.overlaps import extent
from hab_authoring.layouts.vary import LayoutVarier, Variation
from hab_authoring.layouts.write import write_layout_set, write_scene

from hab_tasks.cli import main
from hab_tasks.geometry import compose, inverse, to_matrix
from hab_tasks.world.scenes.fields import read_json
from hab_tasks.world.scenes.habitat.dataset import SceneDataset, resolve_dataset
from hab_tasks.world.scenes.habitat.layout_set import LayoutSet
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.spec import SceneSpec

MACRO = "v3_sc0_staging_00"
KITCHEN = {"fridge_:0000", "kitchen_counter_:0000", "kitchenCupboard_01_:0000", "door2_:0000"}
SOFA = "frl_apartment_sofa_:0000"
COUNT = 8


@dataclass
class Made:
    """Variations of one macro layout, written to a dataset and read from it."""

    varier: LayoutVarier
    variations: list[Variation]
    written: SceneDataset
    specs: list[SceneSpec]

    def motions(self, number: int) -> dict[str, np.ndarray]:
        """Handle -> (4, 4) motion of what moved."""
        before, after = poses_of(self.varier.spec), poses_of(self.specs[number])
        motions = {n: to_matrix(compose(after[n], inverse(before[n]))) for n in before}
        return {n: m for n, m in motions.items() if not np.allclose(m, np.eye(4), atol=1e-6)}


def made(folder: Path, dataset: SceneDataset, macro: str) -> Made:
    varier = LayoutVarier(dataset, macro)
    variations = [varier.make(0, index) for index in range(1, COUNT + 1)]
    scenes = {f"layout_{number}": v.scene for number, v in enumerate(variations)}
    for scene_id, scene in scenes.items():
        write_scene(scene, folder, scene_id)
    names = {"name": "layouts", "dataset": str(dataset.root), "templates": dataset.templates}
    macros = dict.fromkeys(scenes, varier.scene_id)
    write_layout_set(LayoutSet(**names, split="train", wild=False, macros=macros), folder)
    written = SceneDataset(folder)
    return Made(varier, variations, written, [load_scene(written, scene_id) for scene_id in scenes])


def poses_of(spec: SceneSpec) -> dict[str, tuple]:
    poses = {o.name: o.world_from_object for o in spec.objects}
    return poses | {a.name: a.world_from_root for a in spec.articulations}


@pytest.fixture(scope="module", params=["sc0", pytest.param("sc1", marks=pytest.mark.assets)])
def found(request, tmp_path_factory) -> Made:
    """Of the apartment's sc0, and of ReplicaCAD's sc1."""
    real = request.param == "sc1"
    dataset = resolve_dataset(request.getfixturevalue("replica_cad") if real else "apartment")
    return made(tmp_path_factory.mktemp("layouts"), dataset, request.param)


def test_pieces_swap_and_others_are_perturbed_with_what_stands_on_them(found):
    pieces = {piece.name: piece for piece in found.varier.pieces}
    rugs = [extent(flat).box_m[1, 2] for flat in found.varier.flat.all]
    for number, variation in enumerate(found.variations):
        motions = found.motions(number)
        swapped = [name for pair in variation.swapped for name in pair]
        assert len(set(swapped)) == len(swapped) >= 2
        assert variation.perturbed
        assert not set(swapped) & set(variation.perturbed)
        moved = {m: n for n in (*swapped, *variation.perturbed) for m in pieces[n].members}
        assert motions.keys() == moved.keys()
        for member, motion in motions.items():
            assert np.allclose(motion, motions[moved[member]], atol=1e-5), member
            # Nothing is raised but onto rugs, nor tilted.
            assert np.allclose(motion[2], (0, 0, 1, motion[2, 3]), atol=1e-6), member
            assert abs(motion[2, 3]) <= max(rugs) + 1e-6
        for pair in variation.swapped:
            for piece, place in (pair, pair[::-1]):
                _stands_in_place(pieces[piece], pieces[place], motions[piece])
        for name in variation.perturbed:
            _moved_a_little(pieces[name], motions[name])


def _stands_in_place(piece, place, motion):
    """Its back points as the other's did, and it stands there, aside by what fits at most."""
    back = motion[:2, :2] @ piece.back
    assert np.allclose(back, place.back, atol=1e-5)
    offset = motion[:2, :2] @ piece.center_m + motion[:2, 3] - place.center_m
    across = offset @ np.array((-back[1], back[0]))
    assert abs(across) <= 0.3 + abs(piece.half_m[1] - place.half_m[1]) + 1e-5
    if place.wall_gap_m is None:
        assert offset @ back == pytest.approx(0.0, abs=1e-5)
    else:
        # Its back keeps the same distance from the wall, but 1 cm at least.
        gap = place.half_m[0] + place.wall_gap_m - (offset @ back + piece.half_m[0])
        assert gap == pytest.approx(max(place.wall_gap_m, 0.01), abs=1e-5)


def _moved_a_little(piece, motion):
    shift = motion[:2, :2] @ piece.center_m + motion[:2, 3] - piece.center_m
    turn = math.degrees(math.atan2(motion[1, 0], motion[0, 0]))
    if piece.wall_gap_m is None:
        assert 0.05 - 1e-6 <= np.linalg.norm(shift) <= 0.3 + 1e-6
        assert abs(turn) <= 20 + 1e-6
    else:
        assert shift @ piece.back == pytest.approx(0.0, abs=1e-6)
        assert 0.05 - 1e-6 <= np.linalg.norm(shift) <= 0.5 + 1e-6
        assert turn == pytest.approx(0.0, abs=1e-5)


def test_dependents_are_found_by_geometry():
    varier = LayoutVarier(resolve_dataset("apartment"), MACRO)
    (members,) = (piece.members for piece in varier.pieces if piece.name == SOFA)
    kinds = {o.name: o.template.category for o in varier.spec.objects}
    assert {kinds[name] for name in {*members} - {SOFA}} == {"cushion"}


def test_everything_else_stays_as_it_was_and_as_usable(found):
    macro = read_json(found.varier.dataset.scene_file(found.varier.scene_id))
    for number, variation in enumerate(found.variations):
        scene, motions = copy.deepcopy(variation.scene), found.motions(number)
        assert not KITCHEN & motions.keys()
        changed = 0
        for key in ("object_instances", "articulated_object_instances"):
            for entry, original in zip(scene[key], macro[key], strict=True):
                changed += entry != original
                entry |= {k: original[k] for k in ("translation", "rotation") if k in original}
        assert changed == len(motions)
        assert scene == macro
        faults = check_layout(found.written, found.specs[number].scene_id).reasons
        # Overlaps of ReplicaCAD's own layouts stay; there are no others.
        assert [fault for fault in faults if not fault.startswith("overlap")] == []


def test_the_command_writes_layouts(tmp_path, capsys):
    out = tmp_path / "layouts"
    arguments = ["vary", "apartment", "--macro", "sc0", "--count", "2", "--out", str(out)]
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert f"wrote 2 layouts of {MACRO} to {out}" in said
    assert "overlap" in said.partition("rejected")[2]
    files = [f"v3_sc0_staging_0{i}.scene_instance.json" for i in (1, 2)]
    assert {path.name for path in out.iterdir()} == {*files, "layouts.json"}
    second = read_json(out / files[1])
    assert main(arguments) == 2
    assert "--force" in capsys.readouterr().err
    assert main([*arguments, "--force", "--seed", "1"]) == 0
    assert read_json(out / files[1]) != second
