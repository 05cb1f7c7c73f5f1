"""Episode files that are damaged, of another environment, or incomplete for their environment."""

import gzip
import json
import math
import os
from copy import deepcopy
from functools import partial
from pathlib import Path

import pytest
from refusals import refused_by_call

import hab_tasks
from hab_tasks.cli import main
from hab_tasks.envs import ENVS
from hab_tasks.episodes.fields import LARGEST_BYTES

SHIPPED = Path(hab_tasks.__file__).parents[1] / "assets" / "episodes"
NAN, HUGE, HALF = math.nan, 10**400, "\ud800"
POSE = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
FAR = [1e30, *POSE[1:]]

ODD_POSES = {
    "short": POSE[:6],
    "long": [*POSE, 0.0],
    "of_text": ["0"] * 7,
    "text": "0000000",
    "null": None,
    "nan": [NAN, *POSE[1:]],
    "huge": [HUGE, *POSE[1:]],
    "far": FAR,
    "without_rotation": [0.0] * 7,
    "of_flags": [True] * 7,
}
ODD_BASES = {
    "short": [0.0, 1.0],
    "long": [0.0] * 4,
    "nan": [0.0, 0.0, NAN],
    "text": "abc",
    "null": None,
    "far": [1e30, 0.0, 0.0],
    "of_text": ["0", "0", "0"],
}
ODD_OBJECTS = {"list": [1], "number": 3, "text": "x", "null": None}


def first(raw):
    return raw["episodes"][0]


def put(value, *path):
    """Returns what writes a value into the first episode, at `path`."""

    def change(raw):
        place = first(raw)
        for key in path[:-1]:
            place = place[key if key != "*" else next(iter(place))]
        place[path[-1] if path[-1] != "*" else next(iter(place))] = value

    return change


def put_whole(value, *path):
    """Returns what writes a value into the file, at `path`."""

    def change(raw):
        place = raw
        for key in path[:-1]:
            place = place[key]
        place[path[-1]] = value

    return change


def drop(*path):
    def change(raw):
        place = first(raw)
        for key in path[:-1]:
            place = place[key]
        del place[path[-1]]

    return change


def drop_whole(key):
    return lambda raw: raw.pop(key)


def twice(raw):
    raw["episodes"].append(deepcopy(first(raw)))


def of_scene(pose):
    def change(raw):
        raw["scenes"][first(raw)["scene_id"]]["frl_apartment_bowl_01_:0000"] = pose

    return change


# What is done to a file -> words that the refusal holds, beside the file's name.
WHOLE = {
    **{f"{k}_absent": (drop_whole(k), (k, "missing")) for k in ("scenes", "episodes", "made_from")},
    **{f"{k}_absent": (drop_whole(k), (k, "missing")) for k in ("env", "scene_dataset", "split")},
    **{f"{k}_number": (put_whole(3, k), (k,)) for k in ("env", "scene_dataset", "split")},
    **{f"{k}_half": (put_whole(HALF, k), ("surrogates",)) for k in ("env", "split")},
    **{f"seed_{v!r}": (put_whole(v, "seed"), ("seed",)) for v in ("x", 1.5, None, True, 2**70)},
    **{f"scenes_{k}": (put_whole(v, "scenes"), ("scenes",)) for k, v in ODD_OBJECTS.items()},
    **{
        f"episodes_{k}": (put_whole(v, "episodes"), ("episodes",))
        for k, v in {"number": 3, "text": "x", "null": None, "object": {}}.items()
    },
    **{
        f"made_from_{k}": (put_whole(v, "made_from"), ("made_from",))
        for k, v in {**ODD_OBJECTS, "empty": {}, "more": {"colour": 1}}.items()
    },
    "schema_old": (put_whole(2, "schema"), ("schema 2", "hab-tasks episodes")),
    "schema_text": (put_whole("3", "schema"), ("schema '3'",)),
    "no_episode": (put_whole([], "episodes"), ("no episode",)),
    "other_env": (put_whole("HabNothing-v1", "env"), ("HabNothing-v1",)),
    "other_dataset": (put_whole("replicaCAD", "scene_dataset"), ("replicaCAD", "apartment")),
    "other_objects": (put_whole("ycb", "made_from", "objects"), ("ycb", "embedded")),
    "no_objects": (put_whole("lego", "made_from", "objects"), ("lego", "made_from")),
    "odd_digest": (put_whole("12", "made_from", "dataset"), ("made_from",)),
    "odd_version": (put_whole("8", "made_from", "generator"), ("made_from", "'8'")),
    "twice": (twice, ("twice",)),
    **{f"entry_{k}": (put_whole([v], "episodes"), ("episode 0",)) for k, v in ODD_OBJECTS.items()},
}
ENTRY = {
    **{
        f"{key}_absent": (drop(key), (key, "missing"))
        for key in ("id", "scene_id", "seed", "robot", "objects", "targets", "joints")
    },
    **{
        f"{key}_{kind}": (put(value, key), (key,))
        for key in ("robot", "objects", "joints")
        for kind, value in ODD_OBJECTS.items()
    },
    **{f"seed_{v!r}": (put(v, "seed"), ("seed",)) for v in ("x", 1.5, None, -1, 2**70)},
    "seed_huge": (put(HUGE, "seed"), ("seed",)),
    "id_number": (put(3, "id"), ("id",)),
    "id_half": (put(HALF, "id"), ("surrogates",)),
    "scene_unknown": (put("v9", "scene_id"), ("v9",)),
    "scene_number": (put(3, "scene_id"), ("scene_id",)),
    **{f"base_{k}": (put(v, "robot", "base"), ("robot",)) for k, v in ODD_BASES.items()},
    **{
        f"arm_{k}": (put(v, "robot", "arm_qpos_rad"), ("robot",))
        for k, v in {"short": [0.0] * 6, "nan": [NAN] * 7, "text": "x", "null": None}.items()
    },
    **{f"loose_{k}": (of_scene(v), ("frl_",)) for k, v in {"far": FAR}.items()},
    **{f"loose_{k}": (of_scene(v), ("scenes",)) for k, v in ODD_POSES.items() if k != "far"},
    **{f"pose_{k}": (put(v, "objects", "*"), ("objects",)) for k, v in ODD_POSES.items()},
    "object_half": (put(POSE, "objects", HALF), ("surrogates",)),
    **{
        f"targets_{k}": (put(v, "targets"), ("targets",))
        for k, v in {"number": 3, "null": None, "empty": [], "text": "x", "of_one": [3]}.items()
    },
    "target_unknown": (put("ghost", "targets", 0, "object"), ("ghost", "targets")),
    "target_number": (put(3, "targets", 0, "object"), ("targets",)),
    "start_of_one": (put(["table"], "targets", 0, "start"), ("targets",)),
    "start_text": (put("ab", "targets", 0, "start"), ("targets",)),
    "goal_of_three": (put(["a", "b", "c"], "targets", 0, "goal"), ("targets",)),
    **{
        f"goal_pose_{k}": (put(v, "targets", 0, "world_from_goal"), ("targets",))
        for k, v in ODD_POSES.items()
        if v is not None
    },
    "held_unknown": (put("ghost", "held"), ("ghost", "held")),
    "held_number": (put(3, "held"), ("held",)),
    **{
        f"handle_{k}": (put(v, "handle"), ("handle",))
        for k, v in {
            "list": ["f"],
            "text": "f",
            "empty": {},
            "short": {"furniture": "f", "joint": "j"},
            "more": {"furniture": "f", "joint": "j", "marker": "m", "colour": "c"},
            "numbers": {"furniture": 1, "joint": 2, "marker": 3},
        }.items()
    },
    **{
        f"navigation_{k}": (put({"skill": "HabPick-v1", "base": v}, "navigation"), ("navigation",))
        for k, v in ODD_BASES.items()
    },
    "navigation_text": (put("there", "navigation"), ("navigation",)),
    "navigation_empty": (put({}, "navigation"), ("navigation",)),
    "joint_nan": (put({"fridge_:0000": {"top_door_hinge": NAN}}, "joints"), ("joints",)),
    "joint_text": (put({"fridge_:0000": {"top_door_hinge": "wide"}}, "joints"), ("joints",)),
    "joint_number": (put({"fridge_:0000": 0.5}, "joints"), ("joints",)),
}


def lacking(requirements):
    """Yields what an environment asks about, and what takes it away."""
    if requirements.goals:
        yield "no_goal", put(None, "targets", 0, "world_from_goal"), "world_from_goal"
    if requirements.holds:
        yield "not_held", put(None, "held"), "held"
    if len(requirements.articulations) == 1:
        yield "no_handle", put(None, "handle"), "handle"
    if requirements.names_navigation_goal:
        yield "no_navigation_goal", put(None, "navigation"), "navigation"


@pytest.fixture(scope="module")
def of_env():
    """Returns a file with the first shipped episode of an environment, as data."""
    found = {}
    for env_id in ENVS:
        file = SHIPPED / f"{env_id}.apartment.embedded.val.0.json.gz"
        raw = json.loads(gzip.decompress(file.read_bytes()))
        raw["episodes"] = raw["episodes"][:1]
        scene = raw["episodes"][0]["scene_id"]
        found[env_id] = json.dumps(raw | {"scenes": {scene: raw["scenes"][scene]}})
    return lambda env_id: json.loads(found[env_id])


def played_from(file, env_id):
    return partial(ENVS[env_id].env, episodes=str(file), obs_mode="state")


def refused_in(tmp_path, raw, env_id, *words):
    file = tmp_path / "set.json"
    file.write_text(json.dumps(raw), encoding="utf-8")
    refused_by_call(played_from(file, env_id), *words)


def test_a_malformed_file_is_refused(tmp_path, of_env, subtests):
    for case, (change, words) in {**WHOLE, **ENTRY}.items():
        with subtests.test(case):
            raw = of_env("HabPick-v1")
            change(raw)
            known_scene = () if case == "scene_unknown" else ("set.json",)
            refused_in(tmp_path, raw, "HabPick-v1", *known_scene, *words)


def test_a_malformed_episode_is_refused_by_every_env(tmp_path, of_env, subtests):
    others = [env_id for env_id in ENVS if env_id != "HabPick-v1"]
    for number, (case, (change, words)) in enumerate(ENTRY.items()):
        env_id = others[number % len(others)]
        with subtests.test(case, env_id=env_id):
            raw = of_env(env_id)
            change(raw)
            refused_in(tmp_path, raw, env_id, *words)


def test_what_an_env_needs_is_asked_for(tmp_path, of_env, subtests):
    for env_id, entry in ENVS.items():
        for name, change, word in lacking(entry.env.requirements):
            with subtests.test(name, env_id=env_id):
                raw = of_env(env_id)
                change(raw)
                words = ("set.json", first(raw)["id"], word, "missing")
                refused_in(tmp_path, raw, env_id, *words)


def test_place_holds_its_target(tmp_path, of_env):
    raw = of_env("HabPlace-v1")
    first(raw)["objects"]["024_bowl_:0007"] = POSE
    first(raw)["held"] = "024_bowl_:0007"
    refused_in(tmp_path, raw, "HabPlace-v1", "set.json", "held", "024_bowl_:0007")


# Files that are none ---------------------------------------------------------------------------

NO_FILES = (
    (b"", "not a valid episode file"),
    (b'{"schema": 3, "env": "HabPick-v1", "scenes": {"a', "not a valid episode file"),
    (b'{"schema": "\xff\xfe"}', "not a valid episode file"),
    (b"[" * 200_000, "nested too deeply"),
    (b'{"schema": ' + b"9" * 10_000 + b"}", "not a valid episode file"),
    (b"[]", "schema"),
    (b"3", "schema"),
    (b'{"config": null, "episodes": []}', "schema"),  # Habitat's
)


def test_what_is_no_episode_file_is_refused(tmp_path, subtests):
    os.mkfifo(tmp_path / "pipe.json")
    (tmp_path / "folder.json").mkdir()
    for name in ("pipe.json", "folder.json"):
        refused_by_call(played_from(tmp_path / name, "HabPick-v1"), name, "not a regular file")
    file = tmp_path / "set.json"
    refused_by_call(played_from(file, "HabPick-v1"), "set.json", "no such file")
    for data, words in NO_FILES:
        with subtests.test(data=data[:40]):
            file.write_bytes(data)
            refused_by_call(played_from(file, "HabPick-v1"), "set.json", words)


def test_a_damaged_archive_is_refused(tmp_path, subtests):
    whole = (SHIPPED / "HabPick-v1.apartment.embedded.val.0.json.gz").read_bytes()
    file = tmp_path / "set.json.gz"
    for data in (whole[:-1000], b"{}", b"", whole[:-8] + bytes(8)):  # last: checksum
        with subtests.test(size=len(data)):
            file.write_bytes(data)
            refused_by_call(played_from(file, "HabPick-v1"), "set.json.gz", "not a valid")


def test_a_small_archive_of_a_huge_file_is_refused_within_bounds(tmp_path):
    file = tmp_path / "set.json.gz"
    with gzip.open(file, "wb", compresslevel=1) as stream:
        for _ in range(LARGEST_BYTES // 2**20 + 8):
            stream.write(b" " * 2**20)
    assert file.stat().st_size < 3 * 2**20
    refused_by_call(played_from(file, "HabPick-v1"), "set.json.gz", "256 MiB")


# What differs, and is played all the same ------------------------------------------------------


def test_what_has_changed_since_is_told(tmp_path, of_env, caplog):
    file = tmp_path / "set.json"
    for key, words in (("dataset", "dataset apartment"), ("masses", "objects")):
        raw = of_env("HabPick-v1")
        raw["made_from"][key] = "00000000"
        file.write_text(json.dumps(raw))
        caplog.clear()
        played_from(file, "HabPick-v1")().close()
        (message,) = caplog.messages
        assert words in message
        assert "changed since" in message


@pytest.mark.assets
def test_the_commands_refuse_files_of_another_dataset_too(tmp_path, of_env, replica_cad, capsys):
    file = tmp_path / "set.json"
    file.write_text(json.dumps(of_env("HabTidyHouse-v1")))
    for arguments in (
        ["convert", file, "--out", tmp_path / "h.json", "--scene-dataset", replica_cad],
        ["figures", replica_cad, "--out", tmp_path / "figures", "--episodes", file],
    ):
        assert main([str(argument) for argument in arguments]) == 2
        line = capsys.readouterr().err
        assert "apartment" in line
        assert len(line.splitlines()) == 1
    assert list(tmp_path.iterdir()) == [file]
