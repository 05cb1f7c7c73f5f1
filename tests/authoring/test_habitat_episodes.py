"""Fields of Habitat's episode files, its link ids, receptacles and frames, and invalid files."""

import functools
import math
import operator
from dataclasses import replace

import numpy as np
import pytest
from builders import DRAWER_URDF, tiny_dataset
from hab_authoring.habitat.convert import OWN_KEY, read_habitat
from hab_authoring.habitat.entry import HabitatEntries
from hab_authoring.habitat.fields import close, object_frame
from hab_authoring.habitat.layout import HabitatLayout, urdf_links
from habitat_entries import (
    APARTMENT,
    DRAWER,
    MARKERS,
    OBJECTS,
    SCENE,
    SHELF,
    TABLE,
    matrix,
    read,
    set_table,
    tidy_house,
)
from refusals import check_each, refused_by_call

from hab_tasks.episodes.schema import Episode, Rearrangement, RobotStart
from hab_tasks.geometry import IDENTITY, pose, to_matrix
from hab_tasks.robots.fetch import FETCH
from hab_tasks.world.scenes.habitat.dataset import resolve_dataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.meshes import mesh_bounds
from hab_tasks.world.scenes.objects import load_objects
from hab_tasks.world.scenes.spec import Receptacle

IN_DRAWER = (DRAWER, "kitchen_counter_:0000/drawer3")


def test_what_the_fields_mean(tmp_path):
    (episode,) = read(tmp_path, set_table()).episodes
    assert (episode.id, episode.scene_id) == ("7", SCENE)
    assert episode.joints == {
        "fridge_:0000": {"top_door_hinge": 1.5},
        "kitchen_counter_:0000": {"right_slide_top": 0.25, "left_slide_bottom": 0.0},
    }
    names = ["024_bowl_:0000", "003_cracker_box_:0000", "024_bowl_:0001", "013_apple_:0000"]
    assert list(episode.objects) == names
    bowl, apple = episode.targets
    assert (bowl.object, bowl.start) == ("024_bowl_:0001", IN_DRAWER)
    assert apple.start == (SHELF, "fridge_:0000/body")
    assert bowl.goal == apple.goal == (TABLE, "frl_apartment_table_01_:0000")
    assert episode.robot == RobotStart.of(FETCH, (0.0, 0.0, 0.0), FETCH.rest_qpos_rad)


def test_poses_become_z_up(tmp_path):
    entry = set_table()
    entry["rigid_objs"][0][1] = matrix(1, 2, 3)
    # xyzw; turning about Habitat's up axis y is turning about z.
    for heading_rad, yaw_rad in ((math.pi / 2, math.pi / 2), (-3.0, -3.0), (4.0, 4 - 2 * math.pi)):
        rotation = [0, math.sin(heading_rad / 2), 0, math.cos(heading_rad / 2)]
        entry |= {"start_position": [1.0, 0.1, 2.0], "start_rotation": rotation}
        (episode,) = read(tmp_path, entry).episodes
        assert episode.robot.base == pytest.approx((1.0, -2.0, yaw_rad), abs=1e-9)
    world_from_bowl = to_matrix(episode.objects["024_bowl_:0000"])
    # Habitat's y is up, so its (1, 2, 3) is (1, -3, 2); the bowl's own up axis is y.
    middle_m, _ = mesh_bounds(OBJECTS["024_bowl"].visual_file)
    np.testing.assert_allclose(world_from_bowl @ [*middle_m, 1], [1, -3, 2, 1], atol=1e-9)
    np.testing.assert_allclose(world_from_bowl[:3, :2], [[1, 0], [0, 0], [0, 1]], atol=1e-9)


def test_receptacles_suggest_the_env(tmp_path):
    for bodies, env in (
        ([["kitchen_counter_:0000", 7], ["fridge_:0000", 0]], "HabSetTable-v1"),
        ([["fridge_:0000", 0]] * 2, "HabPrepareGroceries-v1"),
        ([["frl_apartment_table_01_:0000", None]] * 2, "HabTidyHouse-v1"),
    ):
        assert read(tmp_path, set_table(target_receptacles=bodies)).env == env


def test_habitat_finds_all_that_it_looks_for():
    episode = Episode(
        id="a",
        scene_id=SCENE,
        seed=1,
        robot=RobotStart.of(FETCH, (1.0, 2.0, 0.0), FETCH.rest_qpos_rad),
        objects={"024_bowl_:0004": IDENTITY, "024_bowl_:0002": IDENTITY},
        targets=(Rearrangement(object="024_bowl_:0004", start=IN_DRAWER),),
        joints={"fridge_:0000": {"top_door_hinge": 2.3}},
    )
    entry = HabitatEntries(APARTMENT, OBJECTS).to_entry(episode)
    assert entry.keys() == set_table().keys(), "Habitat refuses any other field"
    assert [name for name, _ in entry["rigid_objs"]] == ["024_bowl.object_config.json"] * 2
    # The second one that is added; without a goal its start counts.
    assert entry["targets"] == {"024_bowl_:0001": entry["rigid_objs"][1][1]}
    assert entry["ao_states"] == {"fridge_:0000": {"2": 2.3}}
    assert entry["target_receptacles"] == [["kitchen_counter_:0000", 7]]
    assert entry["goal_receptacles"] == [[None, None]]
    assert entry["info"]["object_labels"] == {"024_bowl_:0001": "any_targets|0"}
    assert close(entry["markers"], MARKERS, 0.0)


def link_ids(file):
    return {link.name: link.id for link in urdf_links(file)}


def numbered(names):
    return {name: number for number, name in enumerate(names.split(), start=-1)}


def test_links_are_numbered_depth_first_by_joint_name(tmp_path):
    joints = (("z", "base", "left"), ("b", "base", "right"), ("c", "right", "tray"))
    text = "".join(f'<link name="{name}"/>' for name in ("left", "tray", "base", "right"))
    for name, parent, child in joints:
        text += f'<joint name="{name}" type="fixed"><parent link="{parent}"/>'
        text += f'<child link="{child}"/></joint>'
    file = tmp_path / "tree.urdf"
    file.write_text(f'<robot name="x">{text}</robot>')
    # b comes before z, and all that hangs on `right` before `left`.
    assert link_ids(file) == numbered("base right tray left")


@pytest.mark.parametrize("which", ["apartment", pytest.param(None, marks=pytest.mark.assets)])
def test_ids_of_the_furniture(which, request):
    files = resolve_dataset(which or request.getfixturevalue("replica_cad")).urdf_files
    # In the order of the joints left_slide_bottom, left_slide_top, ..., right_slide_top.
    drawers = "drawer1_bottom drawer1_top drawer2_bottom drawer2_middle drawer2_top drawer4 drawer3"
    assert link_ids(files["kitchen_counter"]) == numbered(f"root body {drawers}")
    assert link_ids(files["fridge"]) == numbered("root body bottom_door top_door")


def test_the_nearest_receptacle_of_a_body_is_meant_unless_it_is_named(tmp_path):
    root = tiny_dataset(tmp_path / "tiny")
    turned = DRAWER_URDF.replace("<parent", f'<origin xyz="0 1 0" rpy="0 0 {math.pi / 2}"/><parent')
    (root / "urdf/chests/chest.urdf").write_text(turned)
    drawer = "chest_:0000/drawer"
    boxes = [("low", drawer, -0.4), ("high", drawer, 0.4)]
    boxes += [("seat", "table_:0000", 0.0), ("seat", "cube_:0000", 0.0)]
    same = {"half_size_m": (0.05, 0.05, 0.05), "up": (0, 1, 0)}
    receptacles = tuple(
        Receptacle(name=name, body=body, body_from_box=pose((x_m, 0, 0), (1, 0, 0, 0)), **same)
        for name, body, x_m in boxes
    )
    spec = load_scene(resolve_dataset(root), SCENE)
    layout = HabitatLayout(replace(spec, receptacles=receptacles))
    # The chest's root is at (-1, 0, 0.2). The drawer's x axis points up, and it is 2 m above (the
    # joint's 1 m at scale 2): the boxes, whose positions are to scale, are at 1.8 m and 2.6 m.
    for height_m, asked, found in (
        (1.7, None, "low"),
        (2.1, None, "low"),
        (2.3, None, "high"),
        (3.0, None, "high"),
        (3.0, "low", "low"),
        (3.0, "seat", "high"),  # not on that body
    ):
        point_m = np.array([-1, 0, height_m])
        ref = layout.receptacle("chest_:0000", 0, asked, point_m)
        assert ref == (found, drawer), (height_m, asked)
    # The table's middle is at (1, -2, 0.4), the cube's at (1, -2, 0.9).
    assert layout.receptacle(None, None, "seat", np.array([1, -2, 0.8])) == ("seat", "cube_:0000")
    assert layout.receptacle(None, None, None, point_m) is None


@pytest.mark.assets
def test_the_frame_of_a_scan_is_upright_and_in_its_middle(ycb):
    frame = object_frame(load_objects(ycb)["003_cracker_box"])
    np.testing.assert_allclose(frame[:3, :3], [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-12)
    # The scan's box is x [-0.049, 0.022], y [-0.096, 0.068], z [-0.004, 0.210].
    np.testing.assert_allclose(frame @ [-0.0135, -0.014, 0.103, 1], [0, 0, 0, 1], atol=2e-3)


# Bad files -------------------------------------------------------------------------------------

FRIDGE = ("ao_states", "fridge_:0000")
BAD = {
    "scene": (["scene_id"], "v3_sc0_staging_99", "Did you mean 'v3_sc0_staging_"),
    "dataset": (
        ["scene_dataset_config"],
        "data/x/replicaCAD.scene_dataset_config.json",
        "made for the scene dataset replicaCAD",
    ),
    "template": (["rigid_objs", 1, 0], "003_cracker.object_config.json", "'003_cracker_box'"),
    "shape": (["rigid_objs", 0, 1], matrix(0, 0, 0)[:3], "(3, 4)"),
    "scaled": (["rigid_objs", 0, 1, 1, 1], 2.0, "not a rigid transform"),
    "no such object": (["targets", "024_bowl_:0002"], matrix(0, 0, 0), "0002"),
    "no such furniture": (["ao_states", "oven_:0000"], {"1": 0}, "fridge_:0000"),
    "fixed link": ([*FRIDGE], {"0": 1}, "1, 2"),
    "state": ([*FRIDGE], {"2": None}, "malformed"),
    "too few": (["target_receptacles"], [["fridge_:0000", 0]], "1 receptacles for 2 targets"),
    "link": (["target_receptacles", 0, 1], 9, "-1, 0, 1"),
    "body": (["goal_receptacles", 1, 0], "tree_:0000", "'tree_:0000'"),
    "name": (["name_to_receptacle", "024_bowl_:0001"], DRAWER[:-1], f"Did you mean '{DRAWER}'"),
    "start": (["start_position"], [0, 0], "malformed"),
    "turn": (["start_rotation"], [0, 0, 0, 0], "four zeros"),
    "ours": (["info"], {OWN_KEY: {"seed": "x"}}, "a value of type int"),
}


def test_bad_entries_are_named(tmp_path):
    def check(case):
        (*path, last), value, words = case
        entry = set_table()
        functools.reduce(operator.getitem, path, entry)[last] = value
        field = f"{tmp_path / 'habitat.json'}: episode '7', field {(*path, last)[0]}"
        refused_by_call(lambda: read(tmp_path, tidy_house(), entry), field, words)

    check_each(BAD, check)


def test_what_is_no_episode_file_is_refused(tmp_path):
    file = tmp_path / "x.json"
    for content in ("[1]", '{"episodes": 3}', "{}"):
        file.write_text(content)
        call = functools.partial(read_habitat, file, APARTMENT, OBJECTS)
        refused_by_call(call, f"{file}: no list `episodes`")
    refused_by_call(lambda: read(tmp_path, {}), "field scene_id", "missing")
    refused_by_call(lambda: read(tmp_path, []), "episode 0: expected an object, found list")
