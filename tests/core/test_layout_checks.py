"""Overlaps, sweeps, floor and reach of layouts, compared with hand-made boxes and the engine."""

import numpy as np
import pytest
from builders import DRAWER_URDF, box_glb, tiny_dataset, write_json, write_scene

from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.layouts.checks import Baseline, check_layout, free_range
from hab_tasks.scenes.habitat.dataset import SceneDataset, resolve_dataset
from hab_tasks.scenes.habitat.load import load_scene
from hab_tasks.scenes.layout_geometry import Bodies, Layout, depth_m, overlaps

SCENE = "v3_sc0_staging_00"
CHEST = {"template_name": "chestOfDrawers_01", "translation": [-1, 0.3, 0], "uniform_scale": 2.0}


def box_template(root, name: str, size_m: tuple[float, float, float]) -> None:
    """A box; x, y (up) and z extents."""
    box_glb(root / f"objects/{name}.glb", size_m)
    config = {
        "render_asset": f"../../objects/{name}.glb",
        "use_bounding_box_for_collision": True,
    }
    write_json(root / f"configs/objects/{name}.object_config.json", config)


def at(name: str, x: float, y: float, z: float) -> dict:
    """An object of a scene file: y is up, so the world has (x, -z, y)."""
    return {"template_name": name, "translation": [x, y, z], "motion_type": "STATIC"}


def dataset_of(tmp_path, *objects: dict, furniture: tuple[dict, ...] = ()) -> SceneDataset:
    """The tiny dataset with other contents, in a room of 7.26 m by 12.93 m."""
    root = tiny_dataset(tmp_path)
    box_template(root, "post", (0.2, 0.2, 0.2))
    box_template(root, "wall", (7.2, 1.0, 0.2))
    chest = root / "urdf/chestOfDrawers_01/chestOfDrawers_01.urdf"
    box_glb(chest.parent / "body.glb", (0.4, 0.3, 0.2))
    chest.write_text(DRAWER_URDF)
    scene = {
        "stage_instance": {"template_name": "stages/room"},
        "object_instances": list(objects),
        "articulated_object_instances": list(furniture),
    }
    write_scene(root, scene)
    return SceneDataset(root)


def layout_of(dataset: SceneDataset) -> Layout:
    return Layout.of(load_scene(dataset, SCENE))


# Overlaps --------------------------------------------------------------------------------------


def test_depth_of_two_boxes(tmp_path):
    # Boxes of 0.2 m side whose middles are 0.17 m apart in x overlap by 0.2 - 0.17 = 0.03 m.
    layout = layout_of(dataset_of(tmp_path, at("post", 0, 1, 0), at("post", 0.17, 1, 0.05)))
    first, second = layout.placed["post_:0000"], layout.placed["post_:0001"]
    assert depth_m(first, second) == pytest.approx(0.03, abs=1e-5)
    found = [(a.name, b.name) for a, b, _ in overlaps(Bodies([first]), layout.bodies)]
    assert found == [("post_:0000", "post_:0001")]
    apart = np.eye(4)
    apart[0, 3] = -0.04
    assert depth_m(first.moved(apart), second) == 0.0


def test_overlaps_of_a_layout_are_told(tmp_path):
    # The table's top is at 0.8 m; the post's lower face at 0.88 - 0.1 = 0.78 m.
    dataset = dataset_of(tmp_path, at("table", 1, 0.4, 2), at("post", 1, 0.88, 2))
    assert check_layout(dataset, SCENE).reasons == (
        "overlap: post_:0000 and table_:0000 by 0.020 m",
    )
    dataset = dataset_of(tmp_path, at("table", 1, 0.4, 2), at("post", 1, 0.891, 2))
    assert check_layout(dataset, SCENE).reasons == ()


# Sweeps ----------------------------------------------------------------------------------------


def test_a_drawer_opens_until_it_meets_something(tmp_path):
    # Scaled by 2, the drawer is a box of 0.2 m with its middle 0.6 m before the chest's, which is
    # at x = -1: its front is at -1 + 0.6 + 0.1 = -0.3 m. It slides by 2 * 0.25 = 0.5 m.
    # The post's near face is at x = 0.02 - 0.1 = -0.08 m, so 0.22 m are free, and 0.01 m of overlap
    # is allowed: of the steps of 0.025 m, 0.225 m is the last.
    dataset = dataset_of(tmp_path, at("post", 0.02, 0.3, 0), furniture=(CHEST,))
    layout = layout_of(dataset)
    (slide,) = layout.joints
    assert (slide.kind, slide.lower, slide.upper) == ("slide", 0.0, pytest.approx(0.5))
    found = free_range(slide, layout.bodies)
    assert found.upper == pytest.approx(0.225)
    assert (found.lower, found.blocker) == (0.0, "post_:0000")
    (reason,) = check_layout(dataset, SCENE).reasons
    assert reason == (
        "blocked joint: chestOfDrawers_01_:0000 slide opens over [0.00, 0.23] m of [0.00, 0.50], "
        "then meets post_:0000"
    )
    away = layout.moved({"post_:0000": _shift(0.0, 0.3)})
    assert free_range(slide, away.bodies).upper == pytest.approx(0.5)


def test_a_blocked_drawer_is_refused_by_the_macro_layout(tmp_path):
    layout = layout_of(dataset_of(tmp_path, at("post", 2, 0.3, 0), furniture=(CHEST,)))
    baseline = Baseline(layout)
    # From x = 2 to x = 0 the post comes before the drawer's way, by another 0.5 m only beside it.
    before = layout.moved({"post_:0000": _shift(-2.0, 0.0)})
    (fault,) = baseline.blocked(before, ["post_:0000"])
    assert fault.kind == "blocked joint"
    assert not list(baseline.overlapping(before, ["post_:0000"]))
    beside = layout.moved({"post_:0000": _shift(-2.0, 0.5)})
    assert not list(baseline.blocked(beside, ["post_:0000"]))
    into = layout.moved({"post_:0000": _shift(-3.0, 0.0)})
    assert {f.kind for f in baseline.overlapping(into, ["post_:0000"])} == {"overlap"}


def test_a_hinge_turns_about_its_axis():
    layout = Layout.of(load_scene(resolve_dataset("apartment"), SCENE))
    hinge = next(joint for joint in layout.joints if joint.name == "top_door_hinge")
    door = layout.placed["fridge_:0000/top_door"]
    open_door = door.moved(hinge.motion(np.pi / 2))
    # A quarter turn: what the door was wide, it is deep, and its height stays.
    assert open_door.box_m[:, 2] == pytest.approx(door.box_m[:, 2], abs=1e-5)
    size, turned = np.ptp(door.box_m, axis=0), np.ptp(open_door.box_m, axis=0)
    assert turned[:2] == pytest.approx(size[1::-1], abs=1e-5)
    assert (open_door.box_m >= hinge.swept_boxes_m[0][0] - 1e-9).all()
    assert (open_door.box_m <= hinge.swept_boxes_m[0][1] + 1e-9).all()


# Floor and reach -------------------------------------------------------------------------------


def test_cut_off_floor_is_measured(tmp_path):
    # The room is x from -2.66 to 4.60, z from -4.76 to 8.17, 7.26 m by 12.93 m. A wall of 7.2 m
    # across it at z = 4 leaves 3 cm at both ends. Beyond it a disc of 0.3 m has
    # (8.17 - 4.1 - 0.6) * (7.26 - 0.6) = 3.47 * 6.66 = 23.1 m2.
    dataset = dataset_of(tmp_path, at("wall", 0.97, 0.5, 4))
    (fault,) = check_layout(dataset, SCENE).faults
    assert fault.kind == "cut-off floor"
    assert float(fault.text.split()[0]) == pytest.approx(23.1, rel=0.04)
    # Half a metre from the room's end nobody fits anyway.
    assert check_layout(dataset_of(tmp_path, at("wall", 0.97, 0.5, 7.6)), SCENE).reasons == ()


def test_a_receptacle_behind_furniture_is_out_of_reach(tmp_path):
    # The table covers z from 7.4 to 8.0. The wall's near face is at z = 6.4, so the floor before it
    # ends at 6.1: the nearest part of the receptacle, inset by a tenth, is 7.46 - 6.1 = 1.36 m off.
    table = at("table", 1, 0.4, 7.7)
    name = "table_:0000 receptacle_aabb_Tbl1_Top1_frl_apartment_table_01"
    assert check_layout(dataset_of(tmp_path, table), SCENE).reasons == ()
    report = check_layout(dataset_of(tmp_path, table, at("wall", 0.97, 0.5, 6.5)), SCENE)
    assert f"out of reach: {name}" in report.reasons


def test_room_at_handles_is_measured():
    dataset = resolve_dataset("apartment")
    layout = Layout.of(load_scene(dataset, SCENE))
    baseline = Baseline(layout)
    assert not list(baseline.cramped(layout, {}))
    fridge = next(a for a in layout.spec.articulations if a.template == "fridge")
    table = next(o for o in layout.spec.objects if o.template.name == "frl_apartment_table_01")
    # The fridge faces +x: the table goes 1 m before it, in the middle of the spawn rectangle.
    start, end = np.array(table.world_from_object[:2]), np.array(fridge.world_from_root[:2])
    motions = {table.name: _shift(*(end - start + np.array((1.0, 0.0))))}
    kinds = {fault.kind for fault in baseline.cramped(layout.moved(motions), motions)}
    assert "no room at a handle" in kinds


# Against the engine ----------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["apartment", pytest.param("real", marks=pytest.mark.assets)])
def test_geometry_is_the_engines(name, request):
    folder = request.getfixturevalue("replica_cad") if name == "real" else "apartment"
    spec = load_scene(resolve_dataset(folder), SCENE)
    layout, sandbox = Layout.of(spec), PlacementSandbox(spec, {})
    joints = {"fridge_:0000": "top_door_hinge", "kitchen_counter_:0000": "right_slide_top"}
    for furniture, joint in joints.items():
        sandbox.set_joint(furniture, joint, 0.4)
    placed = layout.opened({item: 0.4 for item in joints.items()})
    for body in sandbox.bodies.values():
        pose = sandbox.world_from(body.name)
        parts = [placed[n] for n in placed if n == body.name or n.startswith(f"{body.name}/")]
        if body.name == "stage":
            assert len(parts) == len(body.shapes)
        else:
            assert np.allclose(parts[0].world_from_body, pose, atol=1e-5), body.name
        ours = np.concatenate([part.points_m for part in parts], axis=1)
        theirs = [sandbox_points(shape, pose) for shape in body.shapes]
        if theirs:
            assert np.allclose(ours, np.concatenate(theirs, axis=1), atol=1e-5), body.name


def sandbox_points(shape, world_from_body):
    from hab_tasks.scenes.floor import body_points

    return (world_from_body @ body_points(shape))[:3]


def _shift(x_m: float, y_m: float) -> np.ndarray:
    motion = np.eye(4)
    motion[:2, 3] = x_m, y_m
    return motion
