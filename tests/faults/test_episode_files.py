"""Episode files that are damaged, of another environment, or incomplete for their environment."""

import functools
import gzip
import json
import math
import os
import tempfile
from functools import partial
from pathlib import Path

import pytest
from refusals import check_each, refused_by_call, refused_by_command

import hab_tasks
from hab_tasks.cli import main
from hab_tasks.envs import ENVS
from hab_tasks.episodes.schema import LARGEST_BYTES

SHIPPED = Path(hab_tasks.__file__).parents[1] / "assets" / "episodes"
GONE = object()
NAN, HALF = math.nan, "\ud800"
POSE = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]

ODD_POSES = (POSE[:6], ["0"] * 7, None, [NAN, *POSE[1:]], [10**400, *POSE[1:]], [0.0] * 7)


def first(raw):
    return raw["episodes"][0]


def put(value, *path):
    """Writes a value into the first episode; a star stands for the first key."""
    return put_whole(value, "episodes", 0, *path)


def put_whole(value, *path):
    """Writes a value into the file; `GONE` takes it out."""

    def change(raw):
        *above, last = path
        for key in above:
            raw = raw[next(iter(raw)) if key == "*" else key]
        if value is GONE:
            del raw[last]
        else:
            raw[next(iter(raw)) if last == "*" else last] = value

    return change


# What is done to a file, and a word that the refusal holds, beside the file's name.
WHOLE = (
    *((put_whole(GONE, k), k) for k in ("scenes", "episodes", "made_from", "env", "split")),
    *((put_whole(3, k), k) for k in ("env", "scene_dataset", "split", "episodes", "scenes")),
    *((put_whole(value, "seed"), "seed") for value in (1.5, None, True, 2**70)),
    *((put_whole(value, "made_from"), "made_from") for value in ([1], {}, {"colour": 1})),
    (put_whole(HALF, "env"), "UTF-8"),
    (put_whole([None], "episodes"), "episodes[0]"),
    (put_whole(3, "schema"), "schema 3"),
    (put_whole([], "episodes"), "no episode"),
    (put_whole("HabNothing-v1", "env"), "HabNothing-v1"),
    (put_whole("replicaCAD", "scene_dataset"), "replicaCAD"),
    (put_whole("lego", "made_from", "objects"), "lego"),
    (put_whole("12", "made_from", "dataset"), "made_from"),
    (put_whole("8", "made_from", "generator"), '"8"'),
    (put_whole([1e30, *POSE[1:]], "scenes", "*", "frl_apartment_bowl_01_:0000"), "frl_"),
    (lambda raw: raw["episodes"].append(first(raw)), "twice"),
)
ENTRY = (
    *((put(GONE, key), key) for key in ("id", "scene_id", "seed", "robot", "objects", "targets")),
    *((put([1], key), key) for key in ("robot", "objects", "joints")),
    (put(-1, "seed"), "seed"),
    (put(3, "id"), "id"),
    (put("v9", "scene_id"), "v9"),
    *((put(v, "robot", "base"), "robot") for v in ([0.0, 1.0], [0.0, 0.0, NAN], [1e30, 0.0, 0.0])),
    *((put(value, "robot", "arm_qpos_rad"), "robot") for value in ([0.0] * 7, {"pan": 0.0}, None)),
    (put(NAN, "robot", "arm_qpos_rad", "wrist_roll_joint"), "robot"),
    *((put(value, "objects", "*"), "objects") for value in ODD_POSES),
    (put(POSE, "objects", HALF), "UTF-8"),
    *((put(value, "targets"), "targets") for value in ([], [3])),
    (put("ghost", "targets", 0, "object"), "ghost"),
    (put(["table"], "targets", 0, "start"), "targets"),
    (put([0.0] * 7, "targets", 0, "world_from_goal"), "targets"),
    (put("ghost", "held"), "ghost"),
    (put({"furniture": "f", "joint": "j", "marker": "m", "colour": "c"}, "handle"), "handle"),
    (put({}, "navigation"), "navigation"),
    (put({"fridge_:0000": {"hinge": NAN}}, "joints"), "joints"),
    (put({"fridge_:0000": 0.5}, "joints"), "joints"),
)


def lacking(requirements):
    """Yields what takes away what an environment asks about, and its name."""
    if requirements.goals:
        yield put(None, "targets", 0, "world_from_goal"), "world_from_goal"
    if requirements.holds:
        yield put(None, "held"), "held"
    if len(requirements.articulations) == 1:
        yield put(None, "handle"), "handle"
    if requirements.names_navigation_goal:
        yield put(None, "navigation"), "navigation"


@functools.cache
def shipped(env_id):
    """The shipped file of an environment with its first episode only, as text."""
    file = SHIPPED / f"{env_id}.apartment.embedded.val.0.json.gz"
    raw = json.loads(gzip.decompress(file.read_bytes()))
    scene = first(raw)["scene_id"]
    one = {"episodes": raw["episodes"][:1], "scenes": {scene: raw["scenes"][scene]}}
    return json.dumps(raw | one)


def changed(env_id, change):
    """The shipped file of an environment as data, after a change."""
    raw = json.loads(shipped(env_id))
    change(raw)
    return raw


def played_from(file, env_id):
    return partial(ENVS[env_id].env, episodes=str(file), obs_mode="state")


def refused_in(tmp_path, raw, env_id, *words):
    file = tmp_path / "set.json"
    file.write_text(json.dumps(raw), encoding="utf-8")
    refused_by_call(played_from(file, env_id), *words)


def numbered(cases):
    return {str(number): case for number, case in enumerate(cases)}


def test_a_malformed_file_is_refused(tmp_path):
    def check(case):
        change, word = case
        refused_in(tmp_path, changed("HabPick-v1", change), "HabPick-v1", "set.json", word)

    check_each(numbered((*WHOLE, *ENTRY)), check)


def test_what_an_env_needs_is_asked_for(tmp_path):
    def check(case):
        env_id, change, word = case
        raw = changed(env_id, change)
        refused_in(tmp_path, raw, env_id, "set.json", first(raw)["id"], word, "missing")

    cases = [(i, *found) for i, entry in ENVS.items() for found in lacking(entry.env.requirements)]
    check_each(numbered(cases), check)


def test_place_holds_its_target(tmp_path):
    raw = changed("HabPlace-v1", put(POSE, "objects", "024_bowl_:0007"))
    first(raw)["held"] = "024_bowl_:0007"
    refused_in(tmp_path, raw, "HabPlace-v1", "set.json", "held", "024_bowl_:0007")


def test_what_is_no_episode_file_is_refused(tmp_path):
    def check(case):
        name, content, words = case
        file = Path(tempfile.mkdtemp(dir=tmp_path)) / name
        file.write_bytes(content) if isinstance(content, bytes) else content(file)
        refused_by_call(played_from(file, "HabPick-v1"), name, words)

    archive = (SHIPPED / "HabPick-v1.apartment.embedded.val.0.json.gz").read_bytes()
    huge = gzip.compress(b" " * 2**20) * (LARGEST_BYTES // 2**20 + 8)
    assert len(huge) < 3 * 2**20
    cases = (
        ("set.json", os.mkfifo, "not a regular file"),
        ("set.json", lambda file: None, "no such file"),
        ("set.json", b'{"schema": 3, "env": "HabPick-v1", "sce', "not a valid episode file"),
        ("set.json", b'{"a":' * 200_000, "nested too deeply"),
        ("set.json", b'{"config": null, "episodes": []}', "schema"),
        ("set.json.gz", archive[:-1000], "not a valid"),
        ("set.json.gz", archive[:-8] + bytes(8), "not a valid"),
        ("set.json.gz", b"{}", "not a valid"),
        ("set.json.gz", huge, "256 MiB"),
    )
    check_each(numbered(cases), check)


def test_what_has_changed_since_is_told(tmp_path, caplog):
    file = tmp_path / "set.json"
    for key, words in (("dataset", "dataset apartment"), ("masses", "objects")):
        raw = changed("HabPick-v1", put_whole("00000000", "made_from", key))
        file.write_text(json.dumps(raw))
        caplog.clear()
        played_from(file, "HabPick-v1")().close()
        (message,) = caplog.messages
        assert words in message
        assert "changed since" in message


@pytest.mark.assets
def test_the_commands_refuse_files_of_another_dataset_too(tmp_path, replica_cad):
    file = tmp_path / "set.json"
    file.write_text(shipped("HabTidyHouse-v1"))
    convert = ("convert", file, "--out", tmp_path / "h.json", "--scene-dataset", replica_cad)
    refused_by_command(main, convert, "apartment")
    figures = ("figures", replica_cad, "--out", tmp_path / "figures", "--episodes", file)
    refused_by_command(main, figures, "apartment")
    assert list(tmp_path.iterdir()) == [file]
