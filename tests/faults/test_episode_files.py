"""Episode files that are damaged, of another environment, or incomplete for their environment."""

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
from hab_tasks.episodes.fields import LARGEST_BYTES

SHIPPED = Path(hab_tasks.__file__).parents[1] / "assets" / "episodes"
GONE = object()
NAN, HUGE, HALF = math.nan, 10**400, "\ud800"
FRIDGE, HANDLE = "fridge_:0000", ("furniture", "joint", "marker")
POSE = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
FAR = [1e30, *POSE[1:]]

# Values that no pose, base or object of JSON may have.
ODD_POSES = (POSE[:6], ["0"] * 7, None, [NAN, *POSE[1:]], [HUGE, *POSE[1:]], [0.0] * 7, [True] * 7)
ODD_BASES = ([0.0, 1.0], [0.0, 0.0, NAN], "abc", None, [1e30, 0.0, 0.0])
ODD_OBJECTS = ([1], None)


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


def of_scene(pose):
    return put_whole(pose, "scenes", "*", "frl_apartment_bowl_01_:0000")


# What is done to a file, and a word that the refusal holds, beside the file's name.
WHOLE = (
    *((put_whole(GONE, k), k) for k in ("scenes", "episodes", "made_from", "env", "split")),
    *((put_whole(3, k), k) for k in ("env", "scene_dataset", "split", "episodes")),
    *((put_whole(HALF, k), "surrogates") for k in ("env", "split")),
    *((put_whole(value, "seed"), "seed") for value in ("x", 1.5, None, True, 2**70)),
    *((put_whole(value, "scenes"), "scenes") for value in ODD_OBJECTS),
    *((put_whole(value, "made_from"), "made_from") for value in (*ODD_OBJECTS, {}, {"colour": 1})),
    *((put_whole([value], "episodes"), "episode 0") for value in ODD_OBJECTS),
    (put_whole(2, "schema"), "schema 2"),
    (put_whole("3", "schema"), "schema '3'"),
    (put_whole([], "episodes"), "no episode"),
    (put_whole("HabNothing-v1", "env"), "HabNothing-v1"),
    (put_whole("replicaCAD", "scene_dataset"), "replicaCAD"),
    (put_whole("ycb", "made_from", "objects"), "embedded"),
    (put_whole("lego", "made_from", "objects"), "lego"),
    (put_whole("12", "made_from", "dataset"), "made_from"),
    (put_whole("8", "made_from", "generator"), "'8'"),
    (lambda raw: raw["episodes"].append(first(raw)), "twice"),
)
ENTRY = (
    *((put(GONE, key), key) for key in ("id", "scene_id", "seed", "robot", "objects", "targets")),
    *((put(value, key), key) for key in ("robot", "objects", "joints") for value in ODD_OBJECTS),
    *((put(value, "seed"), "seed") for value in ("x", 1.5, None, -1, HUGE)),
    (put(3, "id"), "id"),
    (put(HALF, "id"), "surrogates"),
    (put(3, "scene_id"), "scene_id"),
    *((put(value, "robot", "base"), "robot") for value in ODD_BASES),
    *((put(v, "robot", "arm_qpos_rad"), "robot") for v in ([0.0] * 6, [NAN] * 7, "x", None)),
    (of_scene(FAR), "frl_"),
    (of_scene(POSE[:6]), "scenes"),
    (of_scene([0.0] * 7), "scenes"),
    *((put(value, "objects", "*"), "objects") for value in ODD_POSES),
    (put(POSE, "objects", HALF), "surrogates"),
    *((put(value, "targets"), "targets") for value in (3, None, [], "x", [3])),
    (put("ghost", "targets", 0, "object"), "ghost"),
    (put(3, "targets", 0, "object"), "targets"),
    (put(["table"], "targets", 0, "start"), "targets"),
    (put("ab", "targets", 0, "start"), "targets"),
    (put(["a", "b", "c"], "targets", 0, "goal"), "targets"),
    *((put(v, "targets", 0, "world_from_goal"), "targets") for v in ODD_POSES if v is not None),
    (put("ghost", "held"), "ghost"),
    (put(3, "held"), "held"),
    *((put(value, "handle"), "handle") for value in (["f"], "f", {}, {"furniture": "f"})),
    (put(dict(zip(HANDLE, "fjm", strict=True)) | {"colour": "c"}, "handle"), "handle"),
    (put(dict.fromkeys(HANDLE, 1), "handle"), "handle"),
    *((put({"skill": "X", "base": value}, "navigation"), "navigation") for value in ODD_BASES),
    *((put(value, "navigation"), "navigation") for value in ("there", {})),
    *((put({FRIDGE: {"hinge": value}}, "joints"), "joints") for value in (NAN, "wide")),
    (put({FRIDGE: 0.5}, "joints"), "joints"),
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


def numbered(cases):
    return {str(number): case for number, case in enumerate(cases)}


def test_a_malformed_file_is_refused(tmp_path, of_env):
    def check(case):
        change, word = case
        raw = of_env("HabPick-v1")
        change(raw)
        refused_in(tmp_path, raw, "HabPick-v1", "set.json", word)

    check_each(numbered((*WHOLE, *ENTRY)), check)


def test_a_malformed_episode_is_refused_by_every_env(tmp_path, of_env):
    """Each fault in one of the other envs in turn."""

    def check(case):
        env_id, change, word = case
        raw = of_env(env_id)
        change(raw)
        refused_in(tmp_path, raw, env_id, word)

    others = [env_id for env_id in ENVS if env_id != "HabPick-v1"]
    faults = (*ENTRY, (put("v9", "scene_id"), "v9"))
    check_each(numbered((others[n % len(others)], *fault) for n, fault in enumerate(faults)), check)


def test_what_an_env_needs_is_asked_for(tmp_path, of_env):
    def check(case):
        env_id, change, word = case
        raw = of_env(env_id)
        change(raw)
        refused_in(tmp_path, raw, env_id, "set.json", first(raw)["id"], word, "missing")

    cases = [(i, *found) for i, entry in ENVS.items() for found in lacking(entry.env.requirements)]
    check_each(numbered(cases), check)


def test_place_holds_its_target(tmp_path, of_env):
    raw = of_env("HabPlace-v1")
    first(raw)["objects"]["024_bowl_:0007"] = POSE
    first(raw)["held"] = "024_bowl_:0007"
    refused_in(tmp_path, raw, "HabPlace-v1", "set.json", "held", "024_bowl_:0007")


# Files that are none ---------------------------------------------------------------------------

NO_FILES = {
    "pipe": (os.mkfifo, "not a regular file"),
    "folder": (Path.mkdir, "not a regular file"),
    "absent": (lambda file: None, "no such file"),
    "empty": (b"", "not a valid episode file"),
    "cut": (b'{"schema": 3, "env": "HabPick-v1", "scenes": {"a', "not a valid episode file"),
    "not utf-8": (b'{"schema": "\xff\xfe"}', "not a valid episode file"),
    "deep": (b'{"a":' * 200_000, "nested too deeply"),
    "long number": (b'{"schema": ' + b"9" * 10_000 + b"}", "not a valid episode file"),
    "list": (b"[]", "schema"),
    "habitat": (b'{"config": null, "episodes": []}', "schema"),
}


def test_what_is_no_episode_file_is_refused(tmp_path):
    def check(case):
        content, words = case
        file = Path(tempfile.mkdtemp(dir=tmp_path)) / "set.json"
        file.write_bytes(content) if isinstance(content, bytes) else content(file)
        refused_by_call(played_from(file, "HabPick-v1"), "set.json", words)

    check_each(NO_FILES, check)


def test_a_damaged_archive_is_refused(tmp_path):
    file = tmp_path / "set.json.gz"

    def check(content):
        file.write_bytes(content)
        refused_by_call(played_from(file, "HabPick-v1"), "set.json.gz", "not a valid")

    good = (SHIPPED / "HabPick-v1.apartment.embedded.val.0.json.gz").read_bytes()
    check_each(
        {"cut": good[:-1000], "no gzip": b"{}", "empty": b"", "checksum": good[:-8] + bytes(8)},
        check,
    )


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
def test_the_commands_refuse_files_of_another_dataset_too(tmp_path, of_env, replica_cad):
    file = tmp_path / "set.json"
    file.write_text(json.dumps(of_env("HabTidyHouse-v1")))
    convert = ("convert", file, "--out", tmp_path / "h.json", "--scene-dataset", replica_cad)
    refused_by_command(main, convert, "apartment")
    figures = ("figures", replica_cad, "--out", tmp_path / "figures", "--episodes", file)
    refused_by_command(main, figures, "apartment")
    assert list(tmp_path.iterdir()) == [file]
