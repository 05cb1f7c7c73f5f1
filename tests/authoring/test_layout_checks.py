"""Overlaps, sweeps, floor and reach of layouts, compared with hand-made boxes and the engine."""

import numpy as np
import pytest
from builders import DRAWER_URDF, box_glb, tiny_dataset, write_json, write_scene
from hab_authoring.layouts.checks import Baseline, check_layout, free_range
from hab_authoring.layouts.overlaps import bodies_of, depth_m, rearranged

from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.world.scenes.floor import body_points
from hab_tasks.world.scenes.habitat.dataset import SceneDataset, resolve_dataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.layout_geometry import Layout

SCENE = "v3_sc0_staging_00"
POST = "post_:0000"
CHEST = {"template_name": "chestOfDrawers_01", "translation": [-1, 0.3, 0], "uniform_scale": 2.0}


def at(name: str, x: float, y: float, z: float) -> dict:
    """An object of a scene file: y is up, so the world has (x, -z, y)."""
    return {"template_name": name, "translation": [x, y, z], "motion_type": "STATIC"}


@pytest.fixture
def dataset_of(tmp_path):
    """Makes the tiny dataset with other contents, in a room of 7.26 m by 12.93 m."""
    root = tiny_dataset(tmp_path)
    for name, size_m in {"post": (0.2, 0.2, 0.2), "wall": (7.2, 1.0, 0.2)}.items():
        mesh = box_glb(root / f"objects/{name}.glb", size_m)
        config = {"render_asset": str(mesh), "use_bounding_box_for_collision": True}
        write_json(root / f"configs/objects/{name}.object_config.json", config)
    chest = root / "urdf/chestOfDrawers_01/chestOfDrawers_01.urdf"
    box_glb(chest.parent / "body.glb", (0.4, 0.3, 0.2))
    chest.write_text(DRAWER_URDF)

    def make(*objects: dict) -> SceneDataset:
        scene = {
            "stage_instance": {"template_name": "stages/room"},
            "object_instances": [o for o in objects if o is not CHEST],
            "articulated_object_instances": [o for o in objects if o is CHEST],
        }
        write_scene(root, scene)
        return SceneDataset(root)

    return make


def layout_of(dataset: SceneDataset) -> Layout:
    return Layout.of(load_scene(dataset, SCENE))


def shift(x_m: float, y_m: float) -> np.ndarray:
    motion = np.eye(4)
    motion[:2, 3] = x_m, y_m
    return motion


def test_overlaps_are_measured_and_told(dataset_of):
    # Boxes of 0.2 m side whose middles are 0.17 m apart in x overlap by 0.2 - 0.17 = 0.03 m.
    placed = layout_of(dataset_of(at("post", 0, 1, 0), at("post", 0.17, 1, 0.05))).placed
    assert depth_m(placed[POST], placed["post_:0001"]) == pytest.approx(0.03, abs=1e-5)
    assert depth_m(placed[POST].moved(shift(-0.04, 0)), placed["post_:0001"]) == 0.0
    # The table's top is at 0.8 m; the post's lower face at 0.88 - 0.1 = 0.78 m.
    found = ("overlap: post_:0000 and table_:0000 by 0.020 m",)
    for height_m, reasons in ((0.88, found), (0.891, ())):
        dataset = dataset_of(at("table", 1, 0.4, 2), at("post", 1, height_m, 2))
        assert check_layout(dataset, SCENE).reasons == reasons


def test_a_drawer_opens_until_it_meets_something(dataset_of):
    # Scaled by 2, the drawer is a box of 0.2 m with its middle 0.6 m before the chest's, which is
    # at x = -1: its front is at -1 + 0.6 + 0.1 = -0.3 m. It slides by 2 * 0.25 = 0.5 m.
    # The post's near face is at x = 0.02 - 0.1 = -0.08 m, so 0.22 m are free, and 0.01 m of overlap
    # is allowed: of the steps of 0.025 m, 0.225 m is the last.
    dataset = dataset_of(at("post", 0.02, 0.3, 0), CHEST)
    layout = layout_of(dataset)
    (slide,) = layout.joints
    assert (slide.kind, slide.lower, slide.upper) == ("slide", 0.0, pytest.approx(0.5))
    found = free_range(slide, bodies_of(layout))
    assert (found.lower, found.upper, found.blocker) == (0.0, pytest.approx(0.225), POST)
    assert check_layout(dataset, SCENE).reasons == (
        "blocked joint: chestOfDrawers_01_:0000 slide opens over [0.00, 0.23] m of [0.00, 0.50], "
        "then meets post_:0000",
    )
    away = rearranged(layout, {POST: shift(0.0, 0.3)})
    assert free_range(slide, bodies_of(away)).upper == pytest.approx(0.5)


def test_floor_behind_furniture_is_cut_off_and_its_receptacles_are_out_of_reach(dataset_of):
    # The room is x from -2.66 to 4.60, z from -4.76 to 8.17, 7.26 m by 12.93 m. A wall of 7.2 m
    # across it at z = 4 leaves 3 cm at both ends. Beyond it a disc of 0.3 m has
    # (8.17 - 4.1 - 0.6) * (7.26 - 0.6) = 3.47 * 6.66 = 23.1 m2.
    (fault,) = check_layout(dataset_of(at("wall", 0.97, 0.5, 4)), SCENE).faults
    assert fault.kind == "cut-off floor"
    assert float(fault.text.split()[0]) == pytest.approx(23.1, rel=0.04)
    # Half a metre from the room's end nobody fits anyway.
    assert check_layout(dataset_of(at("wall", 0.97, 0.5, 7.6)), SCENE).reasons == ()
    # The table covers z from 7.4 to 8.0. The wall's near face is at z = 6.4, so the floor before it
    # ends at 6.1: the nearest part of the receptacle, inset by a tenth, is 7.46 - 6.1 = 1.36 m off.
    table = at("table", 1, 0.4, 7.7)
    assert check_layout(dataset_of(table), SCENE).reasons == ()
    reasons = check_layout(dataset_of(table, at("wall", 0.97, 0.5, 6.5)), SCENE).reasons
    name = "table_:0000 receptacle_aabb_Tbl1_Top1_frl_apartment_table_01"
    assert f"out of reach: {name}" in reasons


def test_handles_need_room():
    layout = layout_of(resolve_dataset("apartment"))
    baseline = Baseline(layout)
    assert not list(baseline.cramped(layout, {}))
    fridge = next(a for a in layout.spec.articulations if a.template == "fridge")
    table = next(o for o in layout.spec.objects if o.template.name == "frl_apartment_table_01")
    # The fridge faces +x: the table goes 1 m before it, in the middle of the spawn rectangle.
    x_m, y_m = np.subtract(fridge.world_from_root[:2], table.world_from_object[:2])
    motions = {table.name: shift(x_m + 1.0, y_m)}
    kinds = {fault.kind for fault in baseline.cramped(rearranged(layout, motions), motions)}
    assert "no room at a handle" in kinds


@pytest.mark.parametrize("name", ["apartment", pytest.param("real", marks=pytest.mark.assets)])
def test_geometry_is_the_engines(name, request):
    folder = request.getfixturevalue("replica_cad") if name == "real" else "apartment"
    spec = load_scene(resolve_dataset(folder), SCENE)
    sandbox = PlacementSandbox(spec, {})
    joints = (("fridge_:0000", "top_door_hinge"), ("kitchen_counter_:0000", "right_slide_top"))
    for joint in joints:
        sandbox.set_joint(*joint, 0.4)
    placed = Layout.of(spec).opened(dict.fromkeys(joints, 0.4))
    for body in sandbox.bodies.values():
        pose = sandbox.world_from(body.name)
        theirs = [(pose @ body_points(shape))[:3] for shape in body.shapes]
        ours = [placed[n].points_m for n in placed if f"{n}/".startswith(f"{body.name}/")]
        if theirs:
            assert np.allclose(np.hstack(ours), np.hstack(theirs), atol=1e-5), body.name
