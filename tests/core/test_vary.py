"""Micro-variations: their rules, unchanged parts, and independent checks."""

import copy
import json
import math
import os
import subprocess
import sys
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from builders import cpu_scene, tiny_dataset

from hab_tasks.cli import main
from hab_tasks.errors import GenerationError, UnknownNameError
from hab_tasks.geometry import compose, inverse, to_matrix
from hab_tasks.layouts.checks import free_range
from hab_tasks.layouts.standing import FloorPlan, handle_room, reachable
from hab_tasks.layouts.vary import LayoutVarier, Variation, VaryConfig, macro_scene_id
from hab_tasks.scenes.collision_groups import MOVING
from hab_tasks.scenes.fields import read_json
from hab_tasks.scenes.floor import CELL_M
from hab_tasks.scenes.habitat.dataset import SceneDataset, resolve_dataset
from hab_tasks.scenes.habitat.load import load_scene
from hab_tasks.scenes.habitat.write import write_scene
from hab_tasks.scenes.layout_geometry import Layout
from hab_tasks.scenes.pool import BodyPool
from hab_tasks.scenes.shapes import components
from hab_tasks.scenes.spec import SceneSpec

MACRO = "v3_sc0_staging_00"
KITCHEN = {"fridge_:0000", "kitchen_counter_:0000", "kitchenCupboard_01_:0000", "door2_:0000"}
LISTS = ("object_instances", "articulated_object_instances")
COUNT = 8


# Run by a new Python, as ManiSkill reads MS_ASSET_DIR when it is imported.
BUILD = """
import json, sys
import gymnasium as gym
import mani_skill.envs
from mani_skill.utils.scene_builder.replicacad import ReplicaCADSceneBuilder
class Builder(ReplicaCADSceneBuilder):
    def __init__(self, env):
        super().__init__(env)
        self.build_configs = [sys.argv[1] + ".scene_instance.json"]
        self._navigable_positions = [None]
env = gym.make("ReplicaCAD_SceneManipulation-v1", scene_builder_cls=Builder,
               build_config_idxs=[0], robot_uids="fetch", render_backend="cpu")
env.reset(seed=0)
objects = env.unwrapped.scene_builder.scene_objects
print("BUILT", json.dumps({name: o.pose.raw_pose[0].tolist() for name, o in objects.items()}))
"""


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
    stem = varier.scene_id.removesuffix("_00")
    ids = [f"{stem}_{index:02d}" for index in range(1, COUNT + 1)]
    scenes = {scene_id: v.scene for scene_id, v in zip(ids, variations, strict=True)}
    written = with_scenes(dataset, folder, scenes)
    return Made(varier, variations, written, [load_scene(written, scene_id) for scene_id in ids])


def with_scenes(dataset: SceneDataset, folder: Path, scenes: dict[str, dict]) -> SceneDataset:
    """A dataset of links to another's files, with other scenes of these names."""
    (folder / "configs/scenes").mkdir(parents=True)
    kept = [path for scene_id, path in dataset.scene_files.items() if scene_id not in scenes]
    for path in (*dataset.root.iterdir(), *(dataset.root / "configs").iterdir(), *kept):
        link = folder / path.relative_to(dataset.root)
        if not link.exists():
            link.symlink_to(path)
    for scene_id, scene in scenes.items():
        write_scene(scene, folder / "configs/scenes", scene_id)
    return SceneDataset(folder)


def poses_of(spec: SceneSpec) -> dict[str, tuple]:
    poses = {o.name: o.world_from_object for o in spec.objects}
    return poses | {a.name: a.world_from_root for a in spec.articulations}


@pytest.fixture(scope="module")
def apartment(tmp_path_factory) -> Made:
    return made(tmp_path_factory.mktemp("apartment"), resolve_dataset("apartment"), "sc0")


@pytest.fixture(scope="module")
def real(tmp_path_factory, replica_cad) -> Made:
    return made(tmp_path_factory.mktemp("real"), resolve_dataset(replica_cad), "sc1")


either = pytest.mark.parametrize(
    "which", ["apartment", pytest.param("real", marks=pytest.mark.assets)]
)


# The rule --------------------------------------------------------------------------------------


@either
def test_pieces_swap_and_others_are_perturbed_with_what_stands_on_them(which, request):
    found = request.getfixturevalue(which)
    pieces = {piece.name: piece for piece in found.varier.pieces}
    rugs = [flat.box_m[1, 2] for flat in found.varier.flat.all]
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


def test_dependents_are_found_by_geometry(apartment):
    members = {piece.name: set(piece.members) for piece in apartment.varier.pieces}
    cushions = {o.name for o in apartment.varier.spec.objects if o.template.category == "cushion"}
    on_sofa = members["frl_apartment_sofa_:0000"]
    assert on_sofa & cushions == on_sofa - {"frl_apartment_sofa_:0000"} != set()
    everything = [name for names in members.values() for name in names]
    assert len(everything) == len(set(everything))
    kinds = {o.name: o.template.category for o in apartment.varier.spec.objects}
    assert not {kinds.get(n) for n in everything} & {"rug", "mat", "picture", "clock", "tv_screen"}
    assert not KITCHEN & set(everything)


@either
def test_everything_else_stays_as_it_was(which, request):
    found = request.getfixturevalue(which)
    macro = read_json(found.varier.dataset.scene_file(found.varier.scene_id))
    for number, variation in enumerate(found.variations):
        scene, motions = copy.deepcopy(variation.scene), found.motions(number)
        assert not KITCHEN & motions.keys()
        changed = 0
        for key in LISTS:
            for entry, original in zip(scene[key], macro[key], strict=True):
                changed += entry != original
                entry |= {k: original[k] for k in ("translation", "rotation") if k in original}
        assert changed == len(motions)
        assert scene == macro


# Seeds and errors ------------------------------------------------------------------------------


def test_the_same_seed_and_index_give_the_same_layout(apartment):
    dataset = apartment.varier.dataset
    again = LayoutVarier(dataset, MACRO).make(seed=0, index=3).scene
    assert again == apartment.variations[2].scene
    assert LayoutVarier(dataset, MACRO).make(seed=1, index=3).scene != again
    assert len({json.dumps(v.scene) for v in apartment.variations}) == COUNT


def test_what_cannot_be_varied_is_told(tmp_path, apartment):
    dataset = apartment.varier.dataset
    assert macro_scene_id(dataset, "sc0") == macro_scene_id(dataset, MACRO) == MACRO
    for name in ("sc9", "v3_sc0_staging_01"):
        with pytest.raises(UnknownNameError, match="Unknown macro layout"):
            LayoutVarier(dataset, name)
    tiny = SceneDataset(tiny_dataset(tmp_path))
    with pytest.raises(GenerationError, match="piece without free space"):
        LayoutVarier(tiny, "sc0", VaryConfig(attempts=3)).make(0, 1)


def test_the_command_writes_layouts(tmp_path, capsys, apartment):
    out = tmp_path / "layouts"
    arguments = ["vary", "apartment", "--macro", "sc0", "--count", "2", "--out", str(out)]
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert f"wrote 2 layouts of {MACRO} to {out}" in said
    assert "overlap" in said.partition("rejected")[2]
    files = sorted(path.name for path in out.glob("v3*"))
    assert {path.name for path in out.iterdir()} == {*files, "layouts.json"}
    assert files == [f"v3_sc0_staging_0{i}.scene_instance.json" for i in (1, 2)]
    assert read_json(out / files[1]) == apartment.variations[1].scene
    assert main(arguments) == 2
    assert "--force" in capsys.readouterr().err
    assert main([*arguments, "--force"]) == 0
    assert main(["vary", "apartment", "--macro", "sc0", "--count", "0", "--out", "x"]) == 2


# Checked by other means ------------------------------------------------------------------------


def depths(spec: SceneSpec, open_: bool = False) -> dict[frozenset[str], float]:
    """Overlaps [m] of different pieces as the physics engine sees them, from 5 mm on.

    Args:
        spec: The layout; all of it is built so that every pair of bodies can touch.
        open_: Whether doors and drawers stand as far open as the skills need.
    """
    loose = tuple(replace(o, dynamic=True) for o in spec.objects)
    scene = cpu_scene()
    scene._setup(enable_gpu=False)
    pool = BodyPool(scene, {})
    pool.show(replace(spec, objects=loose), ())
    names = {}
    for name, _, component in components(pool.scene_bodies):
        names[component] = name
        for shape in component.collision_shapes:
            groups = shape.get_collision_groups()
            shape.set_collision_groups([*MOVING, groups[2] & ~(1 << 31), groups[3]])
    for name, furniture in pool.scene_bodies.articulations.items():
        qpos = torch.zeros_like(furniture.get_qpos())
        if open_ and name.startswith(("fridge", "kitchen_counter", "chestOfDrawers")):
            qpos[0] = furniture.get_qlimits()[0, :, 1].clamp(max=2.0)
        furniture.set_qpos(qpos)
    scene.px.step()
    found: dict[frozenset[str], float] = {}
    for contact in scene.px.get_contacts():
        pair = frozenset(names[body] for body in contact.bodies)
        deepest = max((-point.separation for point in contact.points), default=0.0)
        found[pair] = max(found.get(pair, 0.0), deepest)
    return {pair: depth for pair, depth in found.items() if depth > 0.005}


@pytest.mark.slow
@either
def test_the_engine_finds_no_new_overlap(which, request):
    found = request.getfixturevalue(which)
    for open_ in (False, True):
        accepted = depths(found.varier.spec, open_)
        for spec in found.specs:
            for pair, depth in depths(spec, open_).items():
                # A millimetre for the engine's own tolerance; what drawers meet in the macro
                # layout already may go deeper, their joints were measured there.
                allowed_m = max(0.011, accepted.get(pair, 0.0) + 0.001)
                assert depth <= allowed_m, (spec.scene_id, sorted(pair), depth)


@pytest.mark.slow
@pytest.mark.assets
@pytest.mark.render
def test_maniskills_own_builder_loads_what_was_written(real, tmp_path):
    layout = pytest.importorskip("hab_eval.bench.layout")
    spec = real.specs[0]
    layout.make_layout(real.written.root, [spec.scene_id], tmp_path / "data")
    done = subprocess.run(
        [sys.executable, "-c", BUILD, spec.scene_id],
        env={**os.environ, "MS_ASSET_DIR": str(tmp_path / "data")},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert "BUILT" in done.stdout, done.stderr
    built = json.loads(done.stdout.partition("BUILT")[2])
    ours = poses_of(spec)
    fixed = {i: e["template_name"] for i, e in enumerate(real.variations[0].scene[LISTS[0]])}
    counts: Counter[str] = Counter()
    for number, template in fixed.items():
        name = f"{Path(template).name}_:{counts[template]:04d}"
        counts[template] += 1
        if name in ours:
            assert same_pose(built[f"env-0_{template}-{number}"], ours[name]), name
    for name in ("chestOfDrawers_01", "cabinet", "fridge"):
        assert same_pose(built[f"env-0_{name}-0"], ours[f"{name}_:0000"]), name


def same_pose(first, second) -> bool:
    return np.allclose(to_matrix(tuple(first)), to_matrix(tuple(second)), atol=1e-4)


@either
def test_layouts_measured_anew_are_as_usable_as_the_macro_layout(which, request):
    found = request.getfixturevalue(which)
    macro = found.varier.layout
    plan = FloorPlan(macro)
    before = plan.floor()
    reached = {name for name, ok in reachable(macro, plan, before).items() if ok}
    rooms = handle_room(macro, before)
    known = np.logical_or.reduce([*plan.cut_off(before), np.zeros_like(before.room)])
    ranges = {(j.piece, j.name): free_range(j, macro.bodies) for j in macro.joints}
    for spec in found.specs:
        # Read without a mesh, a stage's walls make way for the layout's own furniture.
        layout = Layout.of(replace(spec, stage=found.varier.spec.stage))
        plan = FloorPlan(layout)
        floor = plan.floor()
        for island in plan.cut_off(floor):
            assert CELL_M**2 * (island & ~known).sum() <= 0.3
        after = reachable(layout, plan, floor)
        assert reached <= {name for name, ok in after.items() if ok}
        for handle, room in handle_room(layout, floor).items():
            assert room.working >= min(0.5, rooms[handle].working) - 0.05, handle
            assert room.spawn >= min(0.25, rooms[handle].spawn) - 0.05, handle
        for joint in layout.joints:
            now, needed = free_range(joint, layout.bodies), ranges[joint.piece, joint.name]
            limit = 2.0 if joint.name == "top_door_hinge" else needed.upper
            assert now.upper >= min(needed.upper, limit) - 1e-6, (spec.scene_id, joint.name)
            assert now.lower <= needed.lower + 1e-6, (spec.scene_id, joint.name)
