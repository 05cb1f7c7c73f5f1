"""Fields of Habitat's episode files, and errors for invalid files."""

import copy
import math
import re

import numpy as np
import pytest
from habitat_entries import (
    DRAWER,
    MARKERS,
    SCENE,
    SHELF,
    TABLE,
    matrix,
    read,
    set_table,
    tidy_house,
)

from hab_tasks.episodes.habitat.convert import OWN_KEY, read_habitat
from hab_tasks.episodes.habitat.entry import HabitatEntries
from hab_tasks.episodes.habitat.fields import close
from hab_tasks.episodes.schema import Episode, Rearrangement, RobotStart
from hab_tasks.errors import EpisodeError
from hab_tasks.geometry import IDENTITY, to_matrix
from hab_tasks.robots.robot import ROBOT
from hab_tasks.scenes.habitat.dataset import resolve_dataset
from hab_tasks.scenes.meshes import mesh_bounds
from hab_tasks.scenes.objects import load_objects


@pytest.fixture(scope="module")
def apartment():
    return resolve_dataset("apartment")


@pytest.fixture(scope="module")
def objects():
    return load_objects(None)


def test_what_the_fields_mean(tmp_path, apartment, objects):
    (episode,) = read(tmp_path, apartment, objects, set_table()).episodes
    assert (episode.id, episode.scene_id) == ("7", SCENE)
    assert episode.joints == {
        "fridge_:0000": {"top_door_hinge": 1.5},
        "kitchen_counter_:0000": {"right_slide_top": 0.25, "left_slide_bottom": 0.0},
    }
    assert list(episode.objects) == [
        "024_bowl_:0000",
        "003_cracker_box_:0000",
        "024_bowl_:0001",
        "013_apple_:0000",
    ]
    bowl, apple = episode.targets
    assert bowl.object == "024_bowl_:0001"
    assert bowl.start == (DRAWER, "kitchen_counter_:0000/drawer3")
    assert apple.start == (SHELF, "fridge_:0000/body")
    assert bowl.goal == apple.goal == (TABLE, "frl_apartment_table_01_:0000")
    assert episode.robot == RobotStart(base=(0.0, 0.0, 0.0), arm_qpos_rad=ROBOT.rest_qpos_rad)


def test_poses_become_z_up(tmp_path, apartment, objects):
    rows = matrix(1, 2, 3, 0.0)
    entry = set_table(rigid_objs=[["024_bowl.object_config.json", rows]], targets={})
    entry |= {"target_receptacles": [], "goal_receptacles": [], "name_to_receptacle": {}}
    (episode,) = read(tmp_path, apartment, objects, entry).episodes
    world_from_bowl = to_matrix(episode.objects["024_bowl_:0000"])
    # Habitat's y is up, so its (1, 2, 3) is (1, -3, 2); the bowl's own up axis is y.
    middle_m, _ = mesh_bounds(objects["024_bowl"].visual_file)
    np.testing.assert_allclose(world_from_bowl @ [*middle_m, 1], [1, -3, 2, 1], atol=1e-9)
    np.testing.assert_allclose(world_from_bowl[:3, 1], [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(world_from_bowl[:3, 0], [1, 0, 0], atol=1e-9)


def test_the_base_stands_and_looks_alike(tmp_path, apartment, objects):
    # xyzw; turning about Habitat's up axis y is turning about z.
    for heading_rad, yaw_rad in ((math.pi / 2, math.pi / 2), (-3.0, -3.0), (4.0, 4 - 2 * math.pi)):
        rotation = [0, math.sin(heading_rad / 2), 0, math.cos(heading_rad / 2)]
        entry = set_table(start_position=[1.0, 0.1, 2.0], start_rotation=rotation)
        (episode,) = read(tmp_path, apartment, objects, entry).episodes
        assert episode.robot.base == pytest.approx((1.0, -2.0, yaw_rad), abs=1e-9)


def test_receptacles_suggest_the_env(tmp_path, apartment, objects):
    for changes, env in (
        ({}, "HabSetTable-v1"),
        ({"target_receptacles": [["fridge_:0000", 0]] * 2}, "HabPrepareGroceries-v1"),
        ({"target_receptacles": [["frl_apartment_table_01_:0000", None]] * 2}, "HabTidyHouse-v1"),
    ):
        assert read(tmp_path, apartment, objects, set_table(**changes)).env == env


def test_habitat_finds_all_that_it_looks_for(apartment, objects):
    episode = Episode(
        id="a",
        scene_id=SCENE,
        seed=1,
        robot=RobotStart(base=(1.0, 2.0, 0.0), arm_qpos_rad=ROBOT.rest_qpos_rad),
        objects={"024_bowl_:0004": IDENTITY, "024_bowl_:0002": IDENTITY},
        targets=(
            Rearrangement(object="024_bowl_:0004", start=(DRAWER, "kitchen_counter_:0000/drawer3")),
        ),
        joints={"fridge_:0000": {"top_door_hinge": 2.3}},
    )
    entry = HabitatEntries(apartment, objects).to_entry(episode)
    assert entry.keys() == set_table().keys(), "Habitat refuses any other field"
    assert [name for name, _ in entry["rigid_objs"]] == ["024_bowl.object_config.json"] * 2
    assert list(entry["targets"]) == ["024_bowl_:0001"], "the second one that is added"
    assert entry["targets"]["024_bowl_:0001"] == entry["rigid_objs"][1][1], "no goal: its start"
    assert entry["ao_states"] == {"fridge_:0000": {"2": 2.3}}
    assert entry["target_receptacles"] == [["kitchen_counter_:0000", 7]]
    assert entry["goal_receptacles"] == [[None, None]]
    assert entry["info"]["object_labels"] == {"024_bowl_:0001": "any_targets|0"}
    assert close(entry["markers"], MARKERS, 0.0)


# Bad files -------------------------------------------------------------------------------------


def without(key):
    return lambda entry: entry.pop(key)


def put(value, *path):
    def change(entry):
        for key in path[:-1]:
            entry = entry[key]
        entry[path[-1]] = value

    return change


BAD = {
    "no scene": (without("scene_id"), ("field scene_id", "missing")),
    "scene": (put("v3_sc0_staging_99", "scene_id"), ("scene_id", "Did you mean 'v3_sc0_staging_")),
    "dataset": (
        put("data/x/replicaCAD.scene_dataset_config.json", "scene_dataset_config"),
        ("replicaCAD, not for apartment", "--scene-dataset"),
    ),
    "template": (
        put("003_crackers.object_config.json", "rigid_objs", 1, 0),
        ("rigid_objs[1]", "'003_crackers'", "Did you mean '003_cracker_box'", "024_bowl"),
    ),
    "pair": (put(["024_bowl"], "rigid_objs", 2), ("rigid_objs[2]", "malformed")),
    "shape": (put(matrix(0, 0, 0)[:3], "rigid_objs", 0, 1), ("rigid_objs[0]", "(3, 4)")),
    "nan": (put(math.nan, "rigid_objs", 0, 1, 0, 3), ("rigid_objs[0]", "malformed")),
    "scaled": (put(2.0, "rigid_objs", 0, 1, 1, 1), ("rigid_objs[0]", "not a rigid transform")),
    "words": (put("x", "targets", "024_bowl_:0001"), ("targets['024_bowl_:0001']", "malformed")),
    "no such object": (
        put(matrix(0, 0, 0), "targets", "024_bowl_:0002"),
        ("field targets", "0002"),
    ),
    "no such furniture": (put({"1": 0}, "ao_states", "oven_:0000"), ("ao_states", "fridge_:0000")),
    "fixed link": (put({"0": 1}, "ao_states", "fridge_:0000"), ("ao_states", "'0'", "1, 2")),
    "state": (put({"2": None}, "ao_states", "fridge_:0000"), ("ao_states", "malformed")),
    "too few": (put([["fridge_:0000", 0]], "target_receptacles"), ("1 receptacles for 2 targets",)),
    "link": (put(9, "target_receptacles", 0, 1), ("target_receptacles[0]", "'9'", "-1, 0, 1")),
    "body": (put("tree_:0000", "goal_receptacles", 1, 0), ("goal_receptacles[1]", "'tree_:0000'")),
    "name": (
        put(DRAWER[:-1], "name_to_receptacle", "024_bowl_:0001"),
        ("field name_to_receptacle", f"Did you mean '{DRAWER}'"),
    ),
    "start": (put([0, 0], "start_position"), ("field start_position", "malformed")),
    "turn": (put([0, 0, 0, 0], "start_rotation"), ("field start_rotation", "four zeros")),
    "ours": (put({OWN_KEY: {"seed": "x"}}, "info"), (f"field info.{OWN_KEY}", "malformed")),
}


def test_bad_entries_are_named(tmp_path, apartment, objects):
    wrong = []
    for name, (change, words) in BAD.items():
        entry = copy.deepcopy(set_table())
        change(entry)
        with pytest.raises(EpisodeError) as error:
            read(tmp_path, apartment, objects, tidy_house(), entry)
        message = str(error.value)
        start = f"{tmp_path / 'habitat.json'}: episode '7', field "
        if not message.startswith(start) or not all(word in message for word in words):
            wrong.append((name, message))
    assert wrong == []


def test_what_is_no_episode_file_is_refused(tmp_path, apartment, objects):
    file = tmp_path / "x.json"
    for content in ("[1]", '{"episodes": 3}', "{}"):
        file.write_text(content)
        with pytest.raises(EpisodeError, match=re.escape(f"{file}: no list `episodes`")):
            read_habitat(file, apartment, objects)
    with pytest.raises(EpisodeError, match="episode 1: expected an object, found list"):
        read(tmp_path, apartment, objects, set_table(), [])
