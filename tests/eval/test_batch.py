"""Batched agents: each episode runs once and ends as it does alone."""

from pathlib import Path

import pytest
from hab_eval.cli import main
from stub_runs import journal_ids, results_of, traces_of

HERE = Path(__file__).resolve().parent
RUN = ("run", "--agent", "reaching_agent:reaching", "--env", "HabPick-v1", "--seed", "1")
STUB = ("run", "--agent", "stub_hab:many", "--env", "HabStub-v1")


@pytest.fixture(autouse=True)
def beside_the_agent(monkeypatch):
    monkeypatch.chdir(HERE)


def run(folder, *arguments):
    assert main([*RUN, *map(str, arguments), "--out", str(folder)]) == 0
    return results_of(folder), traces_of(folder)


@pytest.mark.slow
def test_rows_and_workers_change_no_outcome(tmp_path):
    alone = run(tmp_path / "1", "--episodes", 5)
    assert len({episode["steps"] for episode in alone[0]}) > 2  # they end at different times
    assert any(episode["success"] for episode in alone[0])
    for workers in (1, 2):
        folder = tmp_path / f"3-{workers}"
        options = ("--episodes", 5, "--option", "rows=3", "--workers", workers)
        assert run(folder, *options) == alone
        assert sorted(journal_ids(folder)) == [episode["id"] for episode in alone[0]]
    # The three of the journal are kept, the other two are played in two rows.
    journal = folder / "episodes.jsonl"
    journal.write_text("".join(journal.read_text().splitlines(keepends=True)[:3]))
    assert run(folder, *options, "--resume") == alone


@pytest.mark.slow
@pytest.mark.render
def test_images_true_states_and_videos_of_several_rows(tmp_path):
    options = ("--episodes", 2, "--option", "obs_mode=depth", "--option", "privileged=yes")
    alone = run(tmp_path / "1", *options)
    both = run(tmp_path / "2", *options, "--option", "rows=2", "--workers", 2, "--video", 1)
    assert both == alone
    assert len([*(tmp_path / "2").glob("video_*.mp4")]) == 1


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_rows_are_handed_out_and_the_last_ones_stay_empty(cli_process, tmp_path, workers):
    options = ("--episodes", 7, "--workers", workers, "--out", tmp_path / "run")
    done = cli_process(*STUB, *options, "--video", 1)
    assert done.returncode == 0, done.stderr
    episodes = results_of(tmp_path / "run")
    # Seeds 0..6: 0, 3, 6 succeed in 3 steps; 1, 4 end by force in 2; 2, 5 time out in 5.
    assert [episode["steps"] for episode in episodes] == [3, 2, 5, 3, 2, 5, 3]
    assert [*(tmp_path / "run").glob("video_*.mp4")]
    traces = traces_of(tmp_path / "run")
    # Each row was acted on once a step, with its own episode's seed, always in a batch of three.
    for number, episode in enumerate(episodes):
        told = {"seed": number, "acts": episode["steps"], "rows": 3}
        assert traces[episode["id"]] == [told]


@pytest.mark.slow
def test_a_worker_that_dies_names_its_rows(cli, cli_process, tmp_path):
    arguments = (*STUB, "--episodes", 6, "--out", tmp_path / "run")
    done = cli_process(*arguments, "--workers", 2, STUB_KILL_EPISODE="stub/001")
    assert done.returncode == 1
    assert "'stub/001' stopped the run" in done.stderr
    assert "signal 9" in done.stderr
    assert cli(*arguments, "--resume").returncode == 0
