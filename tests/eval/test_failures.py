"""Failure categories: percentages, table and figure."""

import json

import imageio.v2 as imageio
import numpy as np
import pytest
from hab_eval.records.failures import PLANNING, categories, draw_failures, percent
from hab_eval.records.results import video_name, write_record
from site_records import record_of


def test_categories_and_percentages():
    timeout, planned = record_of(["timeout", "force", "force"]), record_of(["execution", None])
    assert categories([timeout]) == ("force", "timeout")
    assert categories([timeout, planned]) == (*PLANNING, "force", "timeout")
    # Of two that are as frequent, the one that comes first in the alphabet.
    assert categories([record_of(["b", "a", "c", "c"])]) == ("c", "a", "b")
    run = record_of(["target plan", "target plan", "timeout", *[None] * 5])
    # 2 and 1 of all 8 episodes.
    shares = [percent(run, name) for name in ("target plan", "motion plan", "timeout")]
    assert shares == [25.0, 0.0, 12.5]


def test_the_command_draws_and_prints(cli, tmp_path):
    run = tmp_path / "run"
    run.mkdir()
    refused = cli("failures", run, "--out", tmp_path / "x.png")
    assert refused.returncode == 2
    assert "run.json: not found" in refused.stderr
    write_record(run / "run.json", record_of(["target plan", None, None, "timeout"]))
    other = tmp_path / "other.json"
    write_record(other, record_of(["execution", None], name="Other", env="HabPlace-v1"))
    out = tmp_path / "failures.png"
    done = cli("failures", run, other, "--out", out)
    assert done.returncode == 0, done.stderr
    for words in ("target plan", "motion plan", "execution", "timeout", "25.0", "50.0", "Other"):
        assert words in done.stdout
    assert "--force" in cli("failures", run, "--out", out).stderr


def test_two_runs_are_compared_episode_by_episode(cli, tmp_path):
    """Of 8 common episodes A alone solves 6 and B none: p = 2 / 2^6 = 0.03125."""
    for name, failures, seed in (
        ("a", [None] * 7 + ["x"], 0),
        ("b", [None] + ["force"] * 7, 0),
        ("c", [None] * 8, 1),
    ):
        (tmp_path / name).mkdir()
        write_record(tmp_path / name / "run.json", record_of(failures, seed=seed))
    episode = json.loads((tmp_path / "b/run.json").read_text())["episodes"][1]["id"]
    (tmp_path / f"b/{video_name(1, episode)}.mp4").touch()
    done = cli("compare", tmp_path / "a", tmp_path / "b")
    assert done.returncode == 0, done.stderr
    assert "8 common episodes: 1 solved by both, 6 by A only, 0 by B only, 1 by" in done.stdout
    assert "p = 0.0312" in done.stdout
    assert done.stdout.count("force, ") == 6
    assert ".mp4" in done.stdout
    refused = cli("compare", tmp_path / "a", tmp_path / "c" / "run.json")
    assert refused.returncode != 0
    assert "no common episodes" in refused.stderr


@pytest.mark.parametrize(("timeouts", "forces"), [(4, 2), (2, 4)])
def test_bars_are_as_high_as_their_percentages(tmp_path, timeouts, forces):
    """The bar of 40 % takes twice the pixels of that of 20 %."""
    failures = ["timeout"] * timeouts + ["force"] * forces + [None] * 4
    draw_failures([record_of(failures)], tmp_path / "x.png")
    picture = np.asarray(imageio.imread(tmp_path / "x.png"))[..., :3]
    blue = np.all(picture == (0, 114, 178), axis=2).sum(axis=0)
    found = np.unique(blue[blue > 20])  # the legend's mark is smaller
    high, low = found.max(), found[found < 0.75 * found.max()].max()
    assert high / low == pytest.approx(2.0, abs=0.15)  # the mark may stand over a bar
