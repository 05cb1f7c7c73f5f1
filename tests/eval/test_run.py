"""`hab-eval run` on the stub environment, in processes as a user starts it."""

import json
import os
import signal

import imageio.v2 as imageio
import numpy as np
import pytest
from hab_eval.records import provenance
from hab_eval.records.results import read_record
from refusals import check_each
from stub_runs import RUN, journal_ids, results_of, traces_of
from stub_runs import results_of as episodes_of


@pytest.mark.slow
def test_each_episode_once_with_one_and_with_two_workers(cli, cli_process, tmp_path):
    for workers, run in ((1, cli), (2, cli_process)):
        out = tmp_path / str(workers)
        done = run(*RUN, "--episodes", 7, "--workers", workers, "--out", out)
        assert done.returncode == 0, done.stderr
        assert sorted(journal_ids(out)) == [f"stub/{i:03d}" for i in range(7)]
    assert episodes_of(tmp_path / "1") == episodes_of(tmp_path / "2")
    record = read_record(out / "run.json")
    assert [episode.id for episode in record.episodes] == [f"stub/{i:03d}" for i in range(7)]
    # Seeds 0..6: 0, 3, 6 succeed; 1, 4 end by force; 2, 5 time out.
    assert (record.summary.success.mean, record.summary.success.n) == (3 / 7, 7)
    assert record.summary.failures == {"force": 2, "timeout": 2}
    assert set(record.timings_s) == {episode.id for episode in record.episodes}


def test_all_tasks_run_with_one_command(cli, tmp_path, monkeypatch):
    monkeypatch.setattr("hab_eval.commands.run.TASKS", ("HabStub-v1", "HabOther-v1"))
    command = (*RUN[:3], "--env", "tasks", "--episodes", 2, "--out", tmp_path)
    for more in ((), ("--resume",)):
        assert cli(*command, *more).returncode == 0
        assert [len(results_of(tmp_path / n)) for n in ("HabStub-v1", "HabOther-v1")] == [2, 2]


def test_output_is_plain_lines_then_tables_and_first_episodes_are_filmed(cli, tmp_path):
    out = tmp_path / "run"
    done = cli(*RUN, "--episodes", 3, "--video", 2, "--out", out)
    assert done.returncode == 0, done.stderr
    assert "[3/3] stub/002 (scene_0): timeout, 5 steps" in done.stdout
    for expected in ("33.3 %", "failure: force", "time: plan", "seconds per step", "this run"):
        assert expected in done.stdout.replace("Stub on HabStub-v1", "this run")
    assert "\x1b[" not in done.stdout
    assert not (out / "traces.jsonl").exists()
    stems = ("video_000_stub-000", "video_001_stub-001")
    names = sorted(path.name for path in out.glob("*video*"))
    assert names == [f"{stem}.{suffix}" for stem in stems for suffix in ("mp4", "png")]
    assert (out / names[0]).stat().st_size > 500
    # The stub is black before its first step; words are below it.
    assert not np.asarray(imageio.imread(out / names[1]))[:64].any()


def test_existing_folder_is_refused(cli, tmp_path):
    out = tmp_path / "run"
    out.mkdir()  # an empty folder holds no result to lose
    assert cli(*RUN, "--episodes", 2, "--out", out).returncode == 0
    before = (out / "run.json").read_bytes()
    again = cli(*RUN, "--episodes", 2, "--out", out)
    assert again.returncode == 2
    assert "--resume to continue its run, --force" in again.stderr
    assert (out / "run.json").read_bytes() == before
    (out / "notes.txt").write_text("keep me")
    forced = cli(*RUN, "--episodes", 3, "--out", out, "--force")
    assert forced.returncode == 0
    assert len(journal_ids(out)) == 3
    assert (out / "notes.txt").read_text() == "keep me"
    # A folder without a run is not resumed; a run that was never started is simply started.
    (tmp_path / "letter.txt").write_text("hello")
    assert "no config.json" in cli(*RUN, "--out", tmp_path, "--resume").stderr
    assert cli(*RUN, "--episodes", 1, "--out", tmp_path / "new", "--resume").returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.long)])
def test_resume_after_ctrl_c(start_cli, wait_for_episodes, cli, tmp_path, workers):
    out = tmp_path / "run"
    arguments = (*RUN, "--episodes", 8, "--out", out)
    process = start_cli(*arguments, "--workers", workers, STUB_STEP_S="0.1")
    wait_for_episodes(process, out, 2)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130, err
    assert "--resume" in err
    assert "Traceback" not in err
    kept = journal_ids(out)
    assert 2 <= len(kept) < 8
    assert not (out / "run.json").exists()
    # A line torn by a power cut is dropped, and its episode runs again.
    with (out / "episodes.jsonl").open("a") as file:
        file.write('{"episode": {"id": "stub/0')
    assert cli(*arguments, "--resume").returncode == 0
    assert journal_ids(out)[: len(kept)] == kept
    assert sorted(journal_ids(out)) == [f"stub/{i:03d}" for i in range(8)]
    clean = tmp_path / "clean"
    assert cli(*RUN, "--episodes", 8, "--out", clean).returncode == 0
    assert episodes_of(out) == episodes_of(clean)


OPTIONAL = ("run", "--agent", "stub_hab:optional", "--env", "HabStub-v1")


def test_resume_wants_the_same_run(cli, tmp_path):
    run = (*OPTIONAL, "--option", "mode=still", "--out", tmp_path / "run")
    assert cli(*run, "--episodes", 2).returncode == 0
    other = (*OPTIONAL, "--option", "mode=lively", "--out", tmp_path / "run")
    done = cli(*other, "--episodes", 3, "--seed", 1, "--resume")
    assert done.returncode == 2
    options = "options: {'mode': 'still'} before, {'mode': 'lively'} now"
    for difference in ("episodes: 2 before, 3 now", "seed: 0 before, 1 now", options):
        assert difference in done.stderr
    # Workers and videos change no number, so they may.
    assert cli(*run, "--episodes", 2, "--workers", 2, "--video", 1, "--resume").returncode == 0
    # A run from before there were options and scores goes on.
    plain = (*RUN, "--episodes", 2, "--out", tmp_path / "old")
    assert cli(*plain).returncode == 0
    for name in ("config.json", "run.json"):
        data = json.loads((tmp_path / "old" / name).read_text())
        assert data.get("config", data).pop("options") == {}
        (tmp_path / "old" / name).write_text(json.dumps(data))
    assert read_record(tmp_path / "old" / "run.json").options == {}
    assert cli(*plain, "--resume").returncode == 0


def test_resumed_run_names_all_its_commits(cli, tmp_path, monkeypatch):
    out = tmp_path / "run"
    for commit in ("aaa", "aaa", "bbb-dirty"):
        monkeypatch.setattr(provenance, "git_commit", lambda commit=commit: commit)
        assert cli(*RUN, "--episodes", 2, "--out", out, "--resume").returncode == 0
    assert read_record(out / "run.json").git == "aaa then bbb-dirty"


@pytest.mark.slow
def test_environment_that_cannot_be_made_leaves_no_folder(cli, cli_process, tmp_path, monkeypatch):
    monkeypatch.setenv("STUB_REFUSE", "control mode 'ee' is not offered")
    for workers, run in ((1, cli), (2, cli_process)):
        done = run(*RUN, "--episodes", 2, "--workers", workers, "--out", tmp_path / "run")
        assert done.returncode == 2
        assert done.stderr == "hab-eval: control mode 'ee' is not offered\n"
        assert not (tmp_path / "run").exists()


def test_agent_that_raises_stops_the_run(cli, tmp_path):
    out = tmp_path / "run"
    arguments = ("run", "--agent", "stub_hab:raising", "--env", "HabStub-v1", "--out", out)
    done = cli(*arguments, "--episodes", 5)
    assert done.returncode == 1
    assert "Episode 'stub/002' stopped the run: ZeroDivisionError: three is too" in done.stderr
    assert "2 of 5 episodes are kept" in done.stderr
    assert journal_ids(out) == ["stub/000", "stub/001"]
    assert "in act" in (out / "error.txt").read_text()


BAD = (
    (("--env", "HabStubb-v1"), "Did you mean 'HabStub-v1'?"),
    (("--agent", "stub_hab:constnt"), "Did you mean 'constant'?"),
    (("--option", "a=1", "--option", "a=2"), "--option a is given twice: '1' and '2'"),
    (("--agent", "stub_hab:optional", "--option", "mod=still"), "Did you mean 'mode'?"),
)


def test_bad_values_are_named_in_one_line(cli, tmp_path):
    def check(case):
        arguments, expected = case
        done = cli(*RUN, *arguments, "--out", tmp_path / "run")
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert expected in done.stderr
        assert not (tmp_path / "run").exists()

    check_each({str(case[0]): case for case in BAD}, check)


@pytest.mark.slow
def test_options_reach_the_agent_in_every_process_and_the_result(cli, cli_process, tmp_path):
    for workers, run in ((1, cli), (2, cli_process)):
        out = tmp_path / str(workers)
        # A value may hold an equals sign of its own.
        options = ("--option", "mode=still", "--option", "file=a=b.pt", "--workers", workers)
        done = run(*OPTIONAL, "--episodes", 1, *options, "--out", out)
        assert done.returncode == 0, done.stderr
        record = read_record(out / "run.json")
        assert record.options == {"file": "a=b.pt", "mode": "still"}
        assert record.episodes[0].episode_return == 0.0  # it would be 3 x 0.5
        assert (record.handle_position, record.target_frame) == (True, "ee")  # as it asked for


@pytest.mark.slow
def test_traces_are_written_apart_and_cut_to_the_finished_episodes(cli, tmp_path):
    out = tmp_path / "run"
    telling = ("run", "--agent", "stub_hab:telling", "--env", "HabStub-v1", "--episodes", 4)
    assert cli(*telling, "--out", out).returncode == 0
    before = traces_of(out)
    # Of 001 the agent tells nothing.
    assert [trace[0]["seed"] for _, trace in sorted(before.items())] == [0, 2, 3]
    assert "seed" not in (out / "episodes.jsonl").read_text()
    assert "trace" not in (out / "run.json").read_text()
    # The power went after the trace of 003 and before its result, and tore what came next.
    journal = out / "episodes.jsonl"
    journal.write_text("".join(journal.read_text().splitlines(keepends=True)[:3]))
    with (out / "traces.jsonl").open("a") as file:
        file.write('{"id": "stub/0')
    assert cli(*telling, "--out", out, "--resume").returncode == 0
    assert len((out / "traces.jsonl").read_text().splitlines()) == 3
    # In this sitting the agent saw the three steps of 003 alone.
    assert traces_of(out) == {**before, "stub/003": [{"seed": 3}, {"steps": 3}]}
    assert cli(*RUN, "--episodes", 1, "--out", out, "--force").returncode == 0
    assert not (out / "traces.jsonl").exists()
