"""The console script `hab-tasks`."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from refusals import refused_by_command

from hab_tasks.cli import COMMANDS, main
from hab_tasks.episodes import read_episodes

SCRIPT = Path(sys.executable).with_name("hab-tasks")


@pytest.mark.parametrize(
    "arguments", [["episodes", "--help"], pytest.param(["list"], marks=pytest.mark.slow)]
)
def test_a_reader_that_has_read_enough_is_no_error(arguments):
    """As in `hab-tasks list | head -1`."""
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as unread:
        done = subprocess.run([SCRIPT, *arguments], stdout=unread, stderr=subprocess.PIPE)
    assert (done.returncode, done.stderr) == (141, b"")


def test_help_lists_the_commands_and_shows_an_example_of_each(run):
    overview = run("--help").stdout
    for command in COMMANDS:
        assert command in overview
        done = run(command, "--help")
        assert done.returncode == 0, command
        assert "Example:" in done.stdout, command
        assert f"hab-tasks {command}" in done.stdout, command


def test_a_command_of_authors_names_what_to_install():
    code = (
        "from importlib import metadata; metadata.entry_points = lambda **_: ()\n"
        "from hab_tasks.cli import main; raise SystemExit(main(['vary', '--count', '3']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "pip install -e assets/authoring" in done.stderr


def test_episodes_are_written_and_never_overwritten(run, tmp_path):
    out = tmp_path / "set.json.gz"
    command = "episodes --env HabTidyHouse-v1 --count 2 --seed 3 --split train --novel objects"
    command = (*command.split(), "--out", out)
    done = run(*command)
    assert done.returncode == 0, done.stderr
    assert "wrote 2 episodes (train)" in done.stdout
    ids = [episode.id for episode in read_episodes(out).episodes]
    assert ids == [f"HabTidyHouse-v1/apartment/train+objects/3/0000{index}" for index in range(2)]
    first = out.read_bytes()
    refused_by_command(main, command, str(out), "--force")
    again = run(*command, "--force")
    assert again.returncode == 0, again.stderr
    assert out.read_bytes() == first, "the same options gave another file"
