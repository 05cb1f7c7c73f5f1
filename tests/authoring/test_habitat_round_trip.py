"""Conversion of episodes to and from Habitat's format is lossless."""

import math
from dataclasses import asdict, replace

import numpy as np
import pytest
from hab_authoring.habitat.convert import OWN_KEY, draw_starts, read_habitat, to_habitat
from hab_authoring.habitat.fields import close
from habitat_entries import APARTMENT, ENTRIES, OBJECTS, SCENE, read, set_table, tidy_house

from hab_tasks.cli import main
from hab_tasks.constants import BASE_RADIUS_M
from hab_tasks.episodes.generators.base import pose_scene
from hab_tasks.episodes.robot_start import START_CLEARANCE_M
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import (
    HandleRef,
    NavigationGoal,
    Rearrangement,
    load_json,
    read_episodes,
    save_json,
    write_episodes,
)
from hab_tasks.geometry import IDENTITY, to_matrix
from hab_tasks.registration import TASKS
from hab_tasks.world.scenes.habitat.dataset import embedded_dataset
from hab_tasks.world.scenes.habitat.load import load_scene

SHIPPED = sorted((embedded_dataset().parent / "episodes").glob("*.json.gz"))


def test_habitats_files_come_back_equal(tmp_path):
    """Also the order of the targets: Habitat counts them as they are listed."""
    for kind, entry in ENTRIES.items():
        suffix = ".json.gz" if kind == "set_table" else ".json"
        episodes = read(tmp_path, entry, name=f"habitat{suffix}")
        write_episodes(episodes, tmp_path / f"ours{suffix}")
        again = read_episodes(tmp_path / f"ours{suffix}")
        assert again == episodes, kind
        save_json(to_habitat(again, APARTMENT, OBJECTS), tmp_path / f"b{suffix}", sort_keys=False)
        before, after = (load_json(tmp_path / f"{name}{suffix}") for name in ("habitat", "b"))
        assert close(before, after, 1e-6), kind
        assert not close(before, {**after, "wrong": 1}, 1e-6)
        (back,) = after["episodes"]
        # By its label the bowl comes before the apple, by name behind it.
        for named in (back["targets"], (back["info"] or {}).get("object_labels", {})):
            assert list(named) == sorted(named, reverse=True), kind


def test_what_was_changed_since_is_written_anew(tmp_path):
    episodes = read(tmp_path, tidy_house(rigid_objs=set_table()["rigid_objs"]))
    (episode,) = episodes.episodes
    apple = (9.0, 8.0, 7.0, *episode.objects["013_apple_:0000"][3:])
    moved = replace(
        episode,
        objects=episode.objects | {"013_apple_:0000": apple},
        robot=replace(episode.robot, base=(4.0, 5.0, 0.0)),
    )
    (back,) = to_habitat(replace(episodes, episodes=(moved,)), APARTMENT, OBJECTS)["episodes"]
    apple_m = np.array(dict(back["rigid_objs"])["013_apple.object_config.json"])[:3, 3]
    np.testing.assert_allclose(apple_m, [9, 7, -8], atol=0.01)  # its frame is in its middle
    assert back["start_position"] == pytest.approx([4, 0, -5])
    assert back["start_rotation"] == pytest.approx([0, 0, 0, 1])
    for kept in ("info", "name_to_receptacle"):
        assert back[kept] == tidy_house()[kept], "what still holds stays"


def plain(episodes):
    """The fields of a set; matrices and directions, as quaternions have two signs."""
    fields = asdict(episodes)
    for episode in fields["episodes"]:
        x, y, yaw = episode["robot"]["base"]
        episode["robot"]["base"] = (x, y, math.cos(yaw), math.sin(yaw))
        episode["objects"] = {k: to_matrix(v).tolist() for k, v in episode["objects"].items()}
        for target in episode["targets"]:
            if target["world_from_goal"]:
                target["world_from_goal"] = to_matrix(target["world_from_goal"]).tolist()
    return fields


def assert_comes_back(tmp_path, episodes):
    file = tmp_path / "habitat.json.gz"
    save_json(to_habitat(episodes, APARTMENT, OBJECTS), file, sort_keys=False)
    back = read_habitat(file, APARTMENT, OBJECTS)
    assert close(plain(back), plain(episodes), 1e-9)


def test_every_field_of_an_episode_comes_back(tmp_path):
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
        robot=replace(first.robot, arm_qpos_rad={n: len(n) / 9 for n in first.robot.arm_qpos_rad}),
    )
    # Targets without a start, a goal or a pose, out of the objects' order; numbers with a gap.
    objects_m = {(n if n != handle else f"{n[:-4]}0009"): p for n, p in second.objects.items()}
    names = sorted(objects_m, reverse=True)
    targets = (
        Rearrangement(object=names[0], goal=target.goal),
        Rearrangement(object=names[1], start=target.start),
        replace(target, object=names[2], goal=target.goal),
    )
    bare = replace(second, objects=objects_m, targets=targets)
    episodes = replace(shipped, episodes=(full, bare), rejections={"fell": 3}, seed=5)
    assert_comes_back(tmp_path, episodes)


def test_shipped_episodes_come_back(tmp_path):
    for file in SHIPPED:
        shipped = read_episodes(file)
        few = replace(shipped, episodes=shipped.episodes[:: max(1, len(shipped) // 5)])
        assert_comes_back(tmp_path, few)
        # Where the goals of a task lie tells their receptacles: no name is written beside.
        for entry in to_habitat(few, APARTMENT, OBJECTS)["episodes"] if few.env in TASKS else ():
            assert "receptacles" not in entry["info"][OWN_KEY]


def test_starts_are_drawn_where_a_file_has_none_and_written_once_they_moved(tmp_path):
    episodes = read(tmp_path, set_table(), tidy_house())
    drawn = draw_starts(episodes, APARTMENT, OBJECTS)
    assert drawn == draw_starts(episodes, APARTMENT, OBJECTS), "the episode's seed decides"
    episode, started = drawn.episodes
    assert started == episodes.episodes[1], "this one has a start"
    base = episode.robot.base
    assert base != (0.0, 0.0, 0.0)
    sandbox = PlacementSandbox(load_scene(APARTMENT, SCENE), OBJECTS)
    pose_scene(sandbox, episode.objects, episode.joints)
    assert not sandbox.robot_touches(base, episode.robot.arm_pose(sandbox.robot), START_CLEARANCE_M)
    assert sandbox.floor().clearance_at(np.array(base[:2])) >= BASE_RADIUS_M
    write_episodes(drawn, tmp_path / "ours.json")
    drawn = read_episodes(tmp_path / "ours.json")
    back, _ = to_habitat(drawn, APARTMENT, OBJECTS)["episodes"]
    assert close(back, set_table(), 1e-6)
    moved = replace(episode, robot=replace(episode.robot, base=(1.0, 2.0, 0.0)))
    (back,) = to_habitat(replace(drawn, episodes=(moved,)), APARTMENT, OBJECTS)["episodes"]
    assert back["start_position"] == [1.0, 0.0, -2.0]


def test_the_command_goes_both_ways_and_tells_what_is_not_read(tmp_path, capsys):
    def told(source, out):
        arguments = (str(tmp_path / source), "--out", str(tmp_path / out))
        assert main(["convert", *arguments]) == 0
        return capsys.readouterr().out

    episodes = read(tmp_path, set_table(), tidy_house())
    there = told("habitat.json", "ours.json")
    wrote = f"wrote 2 episodes (train) for HabSetTable-v1 to {tmp_path / 'ours.json'}"
    for words in (wrote, "rigid_objs (1)", "sampled once: 1", "dropped: nothing"):
        assert words in there
    back = f"wrote 2 episodes in Habitat's format to {tmp_path / 'back.json'}"
    assert back in told("ours.json", "back.json")
    assert close(*(load_json(tmp_path / f"{n}.json") for n in ("habitat", "back")), 1e-6)
    held = replace(episodes.episodes[0], held="024_bowl_:0000", seed=5)
    write_episodes(replace(episodes, episodes=(held,), seed=3), tmp_path / "held.json")
    assert "Habitat ignores: held (1), seed (2)" in told("held.json", "again.json")
