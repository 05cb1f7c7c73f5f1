"""Interrupted episode files: journal, and `hab-tasks episodes --resume`."""

from functools import partial

import pytest
from refusals import refused_by_call, refused_by_command

from hab_tasks.cli import main
from hab_tasks.episodes import EpisodeRequest, open_source
from hab_tasks.episodes.journal import EpisodeJournal

COMMAND = ("episodes", "--env", "HabOpenDrawer-v1", "--split", "train", "--seed", "11")
COUNT = 4


@pytest.fixture(scope="module")
def source():
    return open_source(EpisodeRequest(env_id=COMMAND[2], split="train", seed=11))


@pytest.fixture(scope="module")
def whole(source, tmp_path_factory):
    """The file of an uninterrupted run."""
    source.prepare(COUNT)
    return source.save(COUNT, tmp_path_factory.mktemp("whole") / "out.json")


def test_an_interrupted_run_is_continued_when_asked(run, source, whole, tmp_path):
    out = tmp_path / "out.json"
    with journal_with(source, tmp_path, 3).file.open("ab") as file:
        file.write(b'{"index": 3, "epi')  # interrupted while it wrote a line
    words = "is of an interrupted run. Use --resume to continue it, or --force"
    refused_by_command(main, [*COMMAND, "--count", COUNT, "--out", out], words)
    done = run(*COMMAND, "--count", COUNT, "--workers", 1, "--out", out, "--resume")
    assert done.returncode == 0, done.stderr
    assert f"generated {COUNT} of {COUNT} episodes" in done.stdout
    assert out.read_bytes() == whole.read_bytes()
    assert not (tmp_path / "out.json.journal").exists()


def journal_with(source, tmp_path, count=COUNT):
    """A journal with the first episodes of the source."""
    journal = EpisodeJournal(tmp_path / "out.json.journal", source.configuration())
    journal.open(resume=False, force=False)
    for index in range(count):
        journal.append(index, source.make(index))
    return journal


def reopened(source, journal, **changes):
    again = EpisodeJournal(journal.file, source.configuration() | changes)
    again.open(resume=True, force=False)
    return again


def test_episodes_in_the_journal_are_not_made_again(source, whole, tmp_path):
    entries = reopened(source, journal_with(source, tmp_path)).entries
    other = open_source(EpisodeRequest(env_id=COMMAND[2], split="train", seed=11))
    other.restore(entries, COUNT)
    assert other.prepare(COUNT) is False
    assert other.save(COUNT, tmp_path / "again.json").read_bytes() == whole.read_bytes()


def test_a_journal_that_is_damaged_or_of_another_run_is_refused(source, tmp_path):
    journal = journal_with(source, tmp_path, 1)
    for name, value in {"seed": 12, "env": "HabPick-v1", "dataset": "0" * 8}.items():
        words = f"belongs to another run: {name}: "
        refused_by_call(partial(reopened, source, journal, **{name: value}), words)
    with journal.file.open("a") as file:
        file.write('{"index": 1}\n')
    refused_by_call(partial(reopened, source, journal), "line 3")
