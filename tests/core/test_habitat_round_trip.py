"""Conversion of episodes to and from Habitat's format is lossless."""

import math
from dataclasses import replace

import numpy as np
import pytest
from habitat_entries import (
    ENTRIES,
    SCENE,
    read,
    set_table,
    tidy_house,
)

from hab_tasks.cli import main
from hab_tasks.constants import BASE_RADIUS_M
from hab_tasks.episodes.generators.base import pose_scene
from hab_tasks.episodes.habitat.convert import OWN_KEY, read_habitat, to_habitat
from hab_tasks.episodes.habitat.fields import close
from hab_tasks.episodes.habitat.start import draw_starts
from hab_tasks.episodes.robot_start import START_CLEARANCE_M
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import (
    HandleRef,
    NavigationGoal,
    Rearrangement,
    RobotStart,
    load_json,
    read_episodes,
    save_json,
    write_episodes,
)
from hab_tasks.episodes.source import EpisodeRequest, open_source
from hab_tasks.geometry import IDENTITY, to_matrix
from hab_tasks.registration import ENTRY_POINTS
from hab_tasks.robots.robot import ROBOT
from hab_tasks.scenes.habitat.dataset import embedded_dataset, resolve_dataset
from hab_tasks.scenes.habitat.load import load_scene
from hab_tasks.scenes.objects import load_objects

SHIPPED = sorted((embedded_dataset().parent / "episodes").glob("*.json.gz"))


@pytest.fixture(scope="module")
def apartment():
    return resolve_dataset("apartment")


@pytest.fixture(scope="module")
def objects():
    return load_objects(None)


def test_habitats_files_come_back_equal(tmp_path, apartment, objects):
    for kind, entry in ENTRIES.items():
        suffix = ".json.gz" if kind == "set_table" else ".json"
        episodes = read(tmp_path, apartment, objects, entry, name=f"habitat{suffix}")
        write_episodes(episodes, tmp_path / f"ours{suffix}")
        again = read_episodes(tmp_path / f"ours{suffix}")
        assert again == episodes, kind
        save_json(to_habitat(again, apartment, objects), tmp_path / f"b{suffix}", sort_keys=False)
        before, after = (load_json(tmp_path / f"{name}{suffix}") for name in ("habitat", "b"))
        assert close(before, after, 1e-6), kind
        assert not close(before, {**after, "wrong": 1}, 1e-6)


def test_targets_stay_in_their_order(tmp_path, apartment, objects):
    # Sorted by name the apple would come first, and Habitat counts targets as they are listed.
    for entry in (ENTRIES["set_table"], ENTRIES["first_release"]):
        write_episodes(read(tmp_path, apartment, objects, entry), tmp_path / "ours.json")
        (back,) = to_habitat(read_episodes(tmp_path / "ours.json"), apartment, objects)["episodes"]
        assert list(back["targets"]) == ["024_bowl_:0001", "013_apple_:0000"]
        if entry["info"]:
            assert list(back["info"]["object_labels"]) == ["024_bowl_:0001", "013_apple_:0000"]


def test_what_was_changed_since_is_written_anew(tmp_path, apartment, objects):
    episodes = read(tmp_path, apartment, objects, tidy_house(rigid_objs=set_table()["rigid_objs"]))
    (episode,) = episodes.episodes
    moved = replace(
        episode,
        objects={
            **episode.objects,
            "013_apple_:0000": (9.0, 8.0, 7.0, *episode.objects["013_apple_:0000"][3:]),
        },
        robot=replace(episode.robot, base=(4.0, 5.0, 0.0)),
    )
    (back,) = to_habitat(replace(episodes, episodes=(moved,)), apartment, objects)["episodes"]
    placed = {name: rows for name, rows in reversed(back["rigid_objs"])}
    apple_m = np.array(placed["013_apple.object_config.json"])[:3, 3]
    np.testing.assert_allclose(apple_m, [9, 7, -8], atol=0.01)  # its frame is in its middle
    assert back["start_position"] == pytest.approx([4, 0, -5])
    assert back["start_rotation"] == pytest.approx([0, 0, 0, 1])
    assert back["info"] == tidy_house()["info"], "what still holds stays"
    assert back["name_to_receptacle"] == tidy_house()["name_to_receptacle"]


def assert_same(a, b):
    """Two episodes are equal; poses to a micrometre, whatever the sign of their quaternions."""
    bare = {"objects": {}, "targets": (), "robot": RobotStart(base=(0, 0, 0), arm_qpos_rad=())}
    assert replace(a, **bare) == replace(b, **bare)
    assert a.robot.arm_qpos_rad == b.robot.arm_qpos_rad
    turned = (a.robot.base[2] - b.robot.base[2] + math.pi) % (2 * math.pi) - math.pi
    assert (*np.subtract(a.robot.base[:2], b.robot.base[:2]), turned) == pytest.approx((0, 0, 0))
    assert a.objects.keys() == b.objects.keys()
    refs = [
        [(t.object, t.start, t.goal, t.world_from_goal is None) for t in e.targets] for e in (a, b)
    ]
    assert refs[0] == refs[1]
    pairs = [(a.objects[name], b.objects[name]) for name in a.objects]
    pairs += [
        (s.world_from_goal, t.world_from_goal) for s, t in zip(a.targets, b.targets, strict=True)
    ]
    for one, other in pairs:
        if one is not None:
            np.testing.assert_allclose(to_matrix(one), to_matrix(other), atol=1e-6)


def assert_comes_back(tmp_path, episodes, dataset, objects):
    save_json(to_habitat(episodes, dataset, objects), tmp_path / "habitat.json.gz", sort_keys=False)
    back = read_habitat(tmp_path / "habitat.json.gz", dataset, objects)
    assert replace(back, episodes=()) == replace(episodes, episodes=())
    for before, after in zip(episodes.episodes, back.episodes, strict=True):
        assert_same(before, after)


def test_every_field_of_an_episode_comes_back(tmp_path, apartment, objects):
    (file,) = (f for f in SHIPPED if "SetTable" in f.name)
    shipped = read_episodes(file)
    first, second = shipped.episodes[:2]
    handle, target = next(iter(first.objects)), first.targets[0]
    full = replace(
        first,
        held=handle,
        handle=HandleRef(furniture="fridge_:0000", joint="top_door_hinge", marker="m"),
        navigation=NavigationGoal(skill="HabPick-v1", base=(1.0, 2.0, -3.0)),
        joints={"fridge_:0000": {"top_door_hinge": 1.25}},
        loose={"frl_apartment_vase_01_:0000": IDENTITY},
        robot=replace(first.robot, arm_qpos_rad=(0.1, -0.2, 0.3, 0.4, -0.5, 0.6, 0.7)),
    )
    # Targets without a start, a goal or a pose, out of the objects' order; numbers with a gap.
    objects_m = {(n if n != handle else f"{n[:-4]}0009"): p for n, p in second.objects.items()}
    bare = replace(
        second,
        objects=objects_m,
        targets=tuple(
            Rearrangement(object=name, start=start, goal=goal, world_from_goal=pose)
            for name, start, goal, pose in zip(
                sorted(objects_m, reverse=True),
                (None, target.start, target.start),
                (target.goal, None, target.goal),
                (None, None, target.world_from_goal),
                strict=False,
            )
        ),
    )
    episodes = replace(shipped, episodes=(full, bare), rejections={"fell": 3}, seed=5)
    assert_comes_back(tmp_path, episodes, apartment, objects)


def test_shipped_episodes_come_back(tmp_path, apartment, objects):
    for file in SHIPPED:
        shipped = read_episodes(file)
        few = replace(shipped, episodes=shipped.episodes[:: max(1, len(shipped) // 5)])
        assert_comes_back(tmp_path, few, apartment, objects)


@pytest.mark.parametrize(
    "env_id",
    [
        pytest.param(env_id, marks=pytest.mark.slow if "SetTable" in env_id else pytest.mark.long)
        for env_id in ENTRY_POINTS
    ],
)
def test_generated_episodes_come_back(tmp_path, monkeypatch, env_id):
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))
    source = open_source(EpisodeRequest(env_id=env_id, split="train", seed=11))
    made, templates = source.to_set(2), load_objects(None)
    assert_comes_back(tmp_path, made, source.dataset, templates)
    if env_id in ("HabTidyHouse-v1", "HabPrepareGroceries-v1", "HabSetTable-v1"):
        # Where the goals lie tells their receptacles: no name had to be written beside.
        for entry in to_habitat(made, source.dataset, templates)["episodes"]:
            assert "receptacles" not in entry["info"][OWN_KEY]


# Robot starts ----------------------------------------------------------------------------------


def test_starts_are_drawn_where_a_file_has_none(tmp_path, apartment, objects):
    episodes = read(tmp_path, apartment, objects, set_table(), tidy_house())
    drawn = draw_starts(episodes, apartment, objects)
    assert drawn == draw_starts(episodes, apartment, objects), "the episode's seed decides"
    assert drawn.episodes[1] == episodes.episodes[1], "this one has a start"
    episode = drawn.episodes[0]
    assert episode.robot.base != (0.0, 0.0, 0.0)
    sandbox = PlacementSandbox(load_scene(apartment, SCENE), objects)
    pose_scene(sandbox, episode.objects, episode.joints)
    arm = np.array(episode.robot.arm_qpos_rad)
    assert not sandbox.robot_touches(episode.robot.base, arm, START_CLEARANCE_M)
    assert sandbox.floor().clearance_at(np.array(episode.robot.base[:2])) >= BASE_RADIUS_M


def test_a_drawn_start_is_not_written_unless_it_was_moved(tmp_path, apartment, objects):
    drawn = draw_starts(read(tmp_path, apartment, objects, set_table()), apartment, objects)
    write_episodes(drawn, tmp_path / "ours.json")
    again = read_episodes(tmp_path / "ours.json")
    (back,) = to_habitat(again, apartment, objects)["episodes"]
    assert close(back, set_table(), 1e-6)
    robot = RobotStart(base=(1.0, 2.0, 0.0), arm_qpos_rad=ROBOT.rest_qpos_rad)
    moved = replace(again, episodes=(replace(again.episodes[0], robot=robot),))
    (back,) = to_habitat(moved, apartment, objects)["episodes"]
    assert back["start_position"] == [1.0, 0.0, -2.0]


# The command -----------------------------------------------------------------------------------


def convert(*arguments):
    return main(["convert", *(str(a) for a in arguments)])


def test_the_command_goes_both_ways(tmp_path, apartment, objects, capsys):
    read(tmp_path, apartment, objects, set_table(), tidy_house())
    habitat, ours, back = (tmp_path / f"{name}.json" for name in ("habitat", "ours", "back"))
    assert convert(habitat, "--out", ours) == 0
    there = capsys.readouterr().out
    assert f"wrote 2 episodes (train) for HabSetTable-v1 to {ours}" in there
    assert "rigid_objs (1)" in there
    assert "sampled once: 1" in there
    assert "dropped: nothing" in there
    assert convert(ours, "--out", back) == 0
    assert f"wrote 2 episodes in Habitat's format to {back}" in capsys.readouterr().out
    assert close(load_json(habitat), load_json(back), 1e-6)


def test_the_command_tells_what_habitat_does_not_read(tmp_path, apartment, objects, capsys):
    episodes = read(tmp_path, apartment, objects, set_table())
    (episode,) = episodes.episodes
    ours = replace(episodes, episodes=(replace(episode, held="024_bowl_:0000", seed=5),), seed=3)
    write_episodes(ours, tmp_path / "ours.json")
    assert convert(tmp_path / "ours.json", "--out", tmp_path / "back.json") == 0
    assert "Habitat ignores: held (1), seed (2)" in capsys.readouterr().out
    back = read_habitat(tmp_path / "back.json", apartment, objects)
    assert back.seed == 3
    assert (back.episodes[0].held, back.episodes[0].seed) == ("024_bowl_:0000", 5)
