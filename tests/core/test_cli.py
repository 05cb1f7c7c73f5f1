"""The console script `hab-tasks`."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from builders import tiny_dataset

from hab_tasks.commands import COMMANDS
from hab_tasks.envs import ENVS
from hab_tasks.episodes import read_episodes
from hab_tasks.episodes.generators import starts_of
from hab_tasks.episodes.rejection import RejectedSampleError

SCRIPT = Path(sys.executable).with_name("hab-tasks")


def assert_refused(done, *words):
    """Exit 2 with one line on stderr that holds all `words`, and no traceback."""
    assert done.returncode == 2, done.stderr
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    for word in words:
        assert word in lines[0]
    assert done.stdout == ""


def test_the_script_is_installed():
    done = subprocess.run([SCRIPT, "list"], capture_output=True, text=True)
    assert done.returncode == 0
    assert all(env_id in done.stdout for env_id in ENVS)


def test_the_script_ends_with_status_2_and_one_line():
    done = subprocess.run([SCRIPT, "check", "apartmnt"], capture_output=True, text=True)
    assert_refused(done, "'apartmnt'", "Did you mean 'apartment'")


@pytest.mark.parametrize("arguments", [["list"], ["episodes", "--help"]])
def test_a_reader_that_has_read_enough_is_no_error(arguments):
    """As in `hab-tasks list | head -1`."""
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as unread:
        done = subprocess.run([SCRIPT, *arguments], stdout=unread, stderr=subprocess.PIPE)
    assert (done.returncode, done.stderr) == (141, b"")


def test_list_names_every_env_mode_and_entry(run):
    done = run("list")
    assert done.returncode == 0, done.stderr
    for entry in ENVS.values():
        assert f"{entry.id}: {entry.horizon_steps} steps" in done.stdout
        for mode in entry.env.control_modes:
            assert mode in done.stdout
        for item in entry.env.observation:
            shape = "x".join(map(str, item.shape))
            assert re.search(rf"{item.name} +{shape} +{item.unit}", done.stdout)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_an_example(run, command):
    done = run(command, "--help")
    assert done.returncode == 0
    assert "Example:" in done.stdout
    assert f"hab-tasks {command}" in done.stdout


def test_help_lists_the_commands(run):
    done = run("--help")
    assert done.returncode == 0
    assert all(command in done.stdout for command in COMMANDS)


def test_episodes_are_written_and_never_overwritten(run, tmp_path):
    out = tmp_path / "set.json.gz"
    command = ("episodes", "--env", "HabPick-v1", "--count", 2, "--seed", 3, "--out", out)
    done = run(*command)
    assert done.returncode == 0, done.stderr
    assert re.search(r"wrote 2 episodes \((train|val|test)\)", done.stdout)
    assert len(read_episodes(out)) == 2
    first = out.read_bytes()

    assert_refused(run(*command), str(out), "--force")
    assert out.read_bytes() == first

    again = run(*command, "--force")
    assert again.returncode == 0, again.stderr
    assert out.read_bytes() == first, "the same options gave another file"


def test_episodes_are_made_for_skills_and_tasks_alike(run, tmp_path):
    for env_id in ("HabNavigate-v1", "HabTidyHouse-v1"):
        command = ("episodes", "--env", env_id, "--count", 1, "--split", "train")
        done = run(*command, "--novel", "objects", "--out", tmp_path / f"{env_id}.json")
        assert done.returncode == 0, done.stderr
        (episode,) = read_episodes(tmp_path / f"{env_id}.json").episodes
        assert episode.id.startswith(f"{env_id}/apartment/train+objects/0/")


@pytest.mark.slow
def test_several_processes_make_the_same_episodes(run, tmp_path):
    command = ("episodes", "--env", "HabPlace-v1", "--count", 5, "--seed", 6)
    for workers in (1, 3):
        done = run(*command, "--workers", workers, "--out", tmp_path / f"{workers}.json")
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "1.json").read_bytes() == (tmp_path / "3.json").read_bytes()


def test_refused_candidates_are_told_with_reasons(run, tmp_path, monkeypatch):
    made, refusals = (
        starts_of("HabPick-v1").attempt,
        iter(["too hot", "too cold", "too hot"]),
    )

    def attempt(self, sandbox, rng):
        reason = next(refusals, None)
        if reason:
            raise RejectedSampleError(reason)
        return made(self, sandbox, rng)

    monkeypatch.setattr(starts_of("HabPick-v1"), "attempt", attempt)
    command = ("episodes", "--env", "HabPick-v1", "--count", 1, "--seed", 3)
    done = run(*command, "--out", tmp_path / "set.json")
    assert done.returncode == 0, done.stderr
    told = done.stdout.splitlines()
    assert "  rejected 2: too hot" in told
    assert "  rejected 1: too cold" in told


def test_a_dataset_in_which_nothing_can_be_made_is_one_line(run, tmp_path):
    root = tiny_dataset(tmp_path / "tiny")
    command = ("episodes", "--env", "HabOpenFridge-v1", "--scene-dataset", root, "--count", 1)
    done = run(*command, "--out", tmp_path / "set.json")
    assert done.returncode == 2
    last = done.stderr.strip().splitlines()[-1]
    assert "no start state found" in last
    assert "in the layout': " in last
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "set.json").exists()


BAD = {
    "env": (("episodes", "--env", "HabPik-v1", "--out", "x.json"), ("HabPik-v1", "HabPick-v1")),
    "split": (
        ("episodes", "--env", "HabPick-v1", "--split", "trian", "--out", "x.json"),
        ("'trian'", "Did you mean 'train'"),
    ),
    "scene": (
        ("episodes", "--env", "HabPick-v1", "--scene", "v3_sc0_staging_0", "--out", "x.json"),
        ("'v3_sc0_staging_0'", "Did you mean 'v3_sc0_staging_"),
    ),
    "count": (
        ("episodes", "--env", "HabPick-v1", "--count", "0", "--out", "x.json"),
        ("--count", "0"),
    ),
    "novel": (
        ("episodes", "--env", "HabPick-v1", "--novel", "object", "--out", "x.json"),
        ("'object'", "Did you mean 'objects'"),
    ),
    "workers": (
        ("episodes", "--env", "HabPick-v1", "--workers", "0", "--out", "x.json"),
        ("--workers", "0"),
    ),
    "objects": (
        ("episodes", "--env", "HabPick-v1", "--objects", "/nowhere", "--out", "x.json"),
        ("/nowhere",),
    ),
    "dataset": (("check", "apartmnt"), ("apartmnt", "apartment")),
    "folder": (("check", "/"), ("scene_dataset_config",)),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_and_status_2(run, tmp_path, case):
    arguments, words = BAD[case]
    arguments = [tmp_path / a if a == "x.json" else a for a in arguments]
    assert_refused(run(*arguments), *words)
    assert not (tmp_path / "x.json").exists()


def test_an_out_that_cannot_be_written_is_one_line(run, tmp_path):
    (tmp_path / "file").write_text("")
    out = tmp_path / "file/x.json"
    assert_refused(run("episodes", "--env", "HabPick-v1", "--count", 1, "--out", out), "file")


@pytest.mark.parametrize("arguments", [("list", "--colour"), ("chek",), ("episodes", "--env", "a")])
def test_unknown_and_missing_options_are_status_2(run, arguments):
    done = run(*arguments)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("list", "--fro"), "--fro"),
        (("episodes", "--cuont", "3"), "'--count'"),
        (("lst",), "'list'"),
    ],
)
def test_a_mistyped_option_or_command_is_told_in_one_line(run, arguments, named):
    assert_refused(run(*arguments), named, "Valid: ")
