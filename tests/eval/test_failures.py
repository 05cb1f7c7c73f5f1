"""Failure categories: percentages, table and figure."""

import imageio.v2 as imageio
import numpy as np
import pytest
from hab_eval.errors import ResultError
from hab_eval.failures import (
    PLANNING,
    categories,
    draw_failures,
    failure_table,
    percent,
    read_runs,
)
from hab_eval.results import EpisodeResult, summarize, write_record
from stub_runs import make_record

from hab_tasks.errors import OptionError


@pytest.fixture
def make_run():
    """Makes the record of a run from the failures of its episodes, None for success."""

    def make(*failures, **changes):
        episodes = tuple(
            EpisodeResult(
                id=f"e{i}",
                scene="s",
                success=failure is None,
                stages={},
                steps=1,
                failure=failure,
                episode_return=0.0,
                seconds=0.1,
            )
            for i, failure in enumerate(failures)
        )
        summary = summarize(episodes, {})
        return make_record(episodes=episodes, timings_s={}, summary=summary, **changes)

    return make


def test_categories_of_planning_come_first_and_together(make_run):
    timeout, planned = make_run("timeout", "force", "force"), make_run("execution", None)
    assert categories([timeout]) == ("force", "timeout")
    assert categories([timeout, planned]) == (*PLANNING, "force", "timeout")
    # Of two that are as frequent, the one that comes first in the alphabet.
    assert categories([make_run("b", "a", "c", "c")]) == ("c", "a", "b")
    assert categories([make_run(None)]) == PLANNING


def test_percentages_are_of_all_episodes(make_run):
    run = make_run("target plan", "target plan", "timeout", *[None] * 5)
    assert percent(run, "target plan") == 25.0  # 2 of 8
    assert percent(run, "motion plan") == 0.0
    assert percent(run, "timeout") == 12.5


def cells(records):
    table = failure_table(records)
    return [list(column.cells) for column in table.columns]


def test_runs_are_named_by_what_tells_them_apart(make_run):
    twice = [make_run("x"), make_run("x")]
    assert cells(twice)[0] == ["Stub, seed 0 [1]", "Stub, seed 0 [2]"]
    seeds = [make_run("x"), make_run("x", seed=1), make_run("x", options={"navigation": "oracle"})]
    assert cells(seeds)[0] == ["Stub, seed 0", "Stub, seed 1", "Stub (navigation=oracle)"]
    places = [make_run("x"), make_run("x", env="HabPlace-v1")]
    assert cells(places)[0] == ["Stub", "Stub"]
    assert cells(places)[1] == ["HabPick-v1, apartment", "HabPlace-v1, apartment"]


def test_the_command_draws_and_prints(cli, make_run, tmp_path):
    run = tmp_path / "run"
    run.mkdir()
    write_record(run / "run.json", make_run("target plan", None, None, "timeout"))
    other = tmp_path / "other.json"
    write_record(other, make_run("execution", None, name="Other", env="HabPlace-v1"))
    out = tmp_path / "failures.png"
    done = cli("failures", run, other, "--out", out)
    assert done.returncode == 0, done.stderr
    for words in ("target plan", "motion plan", "execution", "timeout", "25.0", "50.0", "Other"):
        assert words in done.stdout
    picture = np.asarray(imageio.imread(out))
    # Two panels below each other; the bars are blue, (0, 114, 178).
    assert picture.shape[0] > 600
    blue = np.all(picture[..., :3] == (0, 114, 178), axis=2)
    half = len(picture) // 2
    assert blue[:half].any()
    assert blue[half:].any()
    before = out.read_bytes()
    again = cli("failures", run, "--out", out)
    assert again.returncode == 2
    assert "--force" in again.stderr
    assert out.read_bytes() == before
    assert cli("failures", run, "--out", out, "--force").returncode == 0
    assert out.read_bytes() != before


@pytest.mark.parametrize(("timeouts", "forces"), [(4, 2), (2, 4)])
def test_bars_are_as_high_as_their_percentages(make_run, tmp_path, timeouts, forces):
    """The bar of 40 % takes twice the pixels of that of 20 %."""
    failures = ["timeout"] * timeouts + ["force"] * forces + [None] * 4
    draw_failures([make_run(*failures)], tmp_path / "x.png")
    picture = np.asarray(imageio.imread(tmp_path / "x.png"))[..., :3]
    blue = np.all(picture == (0, 114, 178), axis=2).sum(axis=0)
    found = np.unique(blue[blue > 20])  # the legend's mark is smaller
    high, low = found.max(), found[found < 0.75 * found.max()].max()
    assert high / low == pytest.approx(2.0, abs=0.15)  # the mark may stand over a bar


def test_what_cannot_be_read_or_written_is_named(cli, tmp_path):
    with pytest.raises(OptionError, match="at least one run"):
        read_runs([])
    with pytest.raises(ResultError, match=r"run\.json: not found.*--resume"):
        read_runs([tmp_path])
    done = cli("failures", tmp_path / "no.json", "--out", tmp_path / "x.png")
    assert done.returncode == 2
    assert "no.json" in done.stderr
    done = cli("failures", tmp_path, "--out", tmp_path / "x.pdf")
    assert done.returncode == 2
    assert "must end in .png" in done.stderr
