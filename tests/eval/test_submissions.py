"""The commands submit, verify and film."""

import re
from dataclasses import replace

import pytest
from hab_eval.records.leaderboard import default_submissions, read_submissions
from hab_eval.records.provenance import AgentFiles
from hab_eval.records.results import read_record, summarize, write_record
from hab_eval.records.submissions import submission_name
from hab_eval.run.replay import Replay, draw, episode_differences
from refusals import check_each
from site_records import record_of
from stub_runs import RUN

from hab_tasks.errors import OptionError

COMMIT = "44d0491468c4c12ddc8bedff3264925895644262"
DIRTY = AgentFiles(code="0", git=f"{COMMIT}-dirty", data={})
GOOD = {"agent": "hab_spa:spa_priv", "git": COMMIT, "seed": 2}


@pytest.fixture
def board(tmp_path):
    """An empty folder of submissions."""
    folder = tmp_path / "leaderboard" / "submissions"
    folder.mkdir(parents=True)
    return folder


@pytest.fixture
def submit(cli, board, tmp_path):
    """Submits the run folder of a record."""

    def submit_record(record, *options):
        folder = tmp_path / "run"
        folder.mkdir(exist_ok=True)
        write_record(folder / "run.json", record)
        return cli("submit", folder, "--submissions", board, *options)

    return submit_record


def test_names_are_those_of_the_committed_submissions():
    for name, record in read_submissions(default_submissions()).items():
        # An older spelling, from before this command.
        wanted = name.replace("replicacad_wild", "replica_cad_wild")
        assert f"{submission_name(record)}.json" == wanted
    # Held-out objects are part of the name.
    record = record_of([None], agent="a.b:Make-It", env="my_tasks:HabX-v2", split="val+objects")
    assert submission_name(record) == "make_it-x-apartment-objects-seed0"
    # crc32 of "aim", "object"
    record = record_of([None], agent="a:b", env="HabX-v2", split="val", options={"aim": "object"})
    assert submission_name(record) == "b-x-apartment-seed0-options7fee8fe2"


def test_submit_copies_a_run_and_writes_the_leaderboard(cli, board, submit):
    record = record_of([None] * 50, **GOOD)
    done = submit(record)
    assert (done.returncode, done.stderr) == (0, "")
    target = board / "spa_priv-pick-apartment-seed2.json"
    assert read_record(target) == record
    assert "100.0 [92.9, 100.0]" in (board.parent / "LEADERBOARD.md").read_text()
    assert cli("table", "--submissions", board, "--check").returncode == 0

    better = replace(record, device="other")
    again = submit(better)
    assert "exists; give --force to replace it, or --name" in again.stderr
    assert read_record(target) == record
    assert submit(better, "--name", "b").returncode == 0
    assert read_record(board / "b.json") == better
    assert submit(better, "--force").returncode == 0
    assert read_record(target) == better


def other_ids(record):
    episodes = (*record.episodes[:-1], replace(record.episodes[-1], id="HabPick-v1/x/val/2/00049"))
    return replace(record, episodes=episodes, summary=summarize(episodes, {}))


REFUSED = (
    (lambda r: replace(r, git=None), "was not made in a checkout"),
    (lambda r: replace(r, git=f"{COMMIT}-dirty"), "uncommitted changes"),
    (lambda r: replace(r, git=f"{COMMIT} then {COMMIT}"), "resumed on another commit"),
    (lambda r: record_of([None] * 49, **GOOD), "49 episodes; a submission has at least 50"),
    (lambda r: replace(r, agent_files=DIRTY), "the agent's code had uncommitted changes"),
    (lambda r: replace(r, seed=3), 'the protocol .* has "HabPick-v1/apartment/val/3/00000"'),
    (other_ids, r'episodes\[49\]: id is "HabPick-v1/x/val/2/00049"'),
)


def test_submit_refuses_what_nobody_can_rerun(board, submit):
    def check(case):
        edit, message = case
        done = submit(edit(record_of([None] * 50, **GOOD)))
        assert done.returncode == 2
        assert len(done.stderr.splitlines()) == 1
        assert re.search(message, done.stderr), done.stderr
        assert list(board.parent.rglob("*.*")) == []

    check_each({case[1]: case for case in REFUSED}, check)


def test_submit_refuses_bad_files_and_names(board, submit):
    record = record_of([None] * 50, **GOOD)
    for name in ("../x", ".x", "", "a b", "x" * 151):
        done = submit(record, "--name", name)
        assert "--name" in done.stderr
    success = replace(record.summary.success, mean=0.5)
    summary = replace(record.summary, success=success)
    assert "does not follow" in submit(replace(record, summary=summary)).stderr
    (board / "broken.json").write_text("{")
    assert "broken.json" in submit(record).stderr
    assert [one.name for one in board.iterdir()] == ["broken.json"]


@pytest.fixture
def stub_run(cli, tmp_path):
    """A run of nine episodes on the stub, seed 1."""
    assert cli(*RUN, "--seed", 1, "--episodes", 9, "--out", tmp_path / "run").returncode == 0
    return tmp_path / "run"


def test_verify_repeats_a_run(cli, stub_run):
    (one,) = record_of([None]).episodes
    assert episode_differences(one, replace(one, seconds=9.0)) == []
    assert [d.small for d in episode_differences(one, replace(one, episode_return=1e-7))] == [True]
    done = cli("verify", stub_run, "--episodes", 4)
    assert (done.returncode, done.stderr) == (0, "")
    assert "4 episodes repeated: 4 identical." in done.stdout
    assert "stub/002" in cli("verify", stub_run / "run.json", "--episode", 2).stdout
    # The episodes are drawn by a seed.
    assert draw(100, 10, 0) == draw(100, 10, 0) != draw(100, 10, 1)
    assert len(set(draw(100, 10, 0))) == 10
    assert draw(5, 10, 0) == (0, 1, 2, 3, 4)


def edited(folder, **changes):
    """Writes a run again with other values of its third episode; the summary follows."""
    record = read_record(folder / "run.json")
    episodes = list(record.episodes)
    episodes[2] = replace(episodes[2], **changes)
    summary = summarize(episodes, record.timings_s)
    write_record(folder / "run.json", replace(record, episodes=tuple(episodes), summary=summary))
    return episodes[2]


FORGED_EPISODES = (
    ({"steps": 3}, "stub/002: steps: recorded 3, repeated"),
    ({"success": True, "failure": None}, "stub/002: success: recorded true, repeated false"),
    ({"failure": "force"}, 'stub/002: failure: recorded "force", repeated'),
    ({"stages": {"reached": False}}, 'stub/002: stages: recorded {"reached": false}, repeated'),
    ({"episode_return": 9.0}, "stub/002: return: recorded 9.0, repeated"),
    ({"scores": {"sct": 1.0}}, "stub/002: sct: recorded 1.0, repeated NaN"),
    ({"seconds": 9.0}, "agent: seconds: recorded 9.0"),
)


def forged_files(record, **changes):
    return replace(record, agent_files=replace(record.agent_files, **changes))


FORGED_RUNS = (
    (lambda r: replace(r, privileged=True), "agent: privileged: recorded true, repeated false"),
    (lambda r: replace(r, options={**r.options, "mode": "still"}), "stub/000: return: recorded"),
    (lambda r: forged_files(r, data={"w.bin": "0"}), 'agent: w.bin: recorded "0", repeated "6b86'),
    (lambda r: forged_files(r, code="0"), 'agent: code: recorded "0", repeated'),
)


def test_verify_finds_every_kind_of_change(cli, tmp_path):
    folder, weights = tmp_path / "run", tmp_path / "w.bin"
    weights.write_bytes(b"1")
    # With seed 0, episode 2 times out.
    command = ("run", "--agent", "stub_hab:optional", *RUN[3:], "--option", "mode=lively")
    command += ("--option", f"file={weights}", "--seed", 0, "--episodes", 3, "--out", folder)
    assert cli(*command).returncode == 0
    whole, record = (folder / "run.json").read_bytes(), read_record(folder / "run.json")

    def check(case):
        changes, line = case
        (folder / "run.json").write_bytes(whole)
        if callable(changes):
            write_record(folder / "run.json", changes(record))
        else:
            edited(folder, **changes)
        done = cli("verify", folder, "--episodes", 3)
        assert done.returncode == 1
        assert f"different: {'' if line.startswith('agent') else 'episode '}{line}" in done.stdout
        assert "; recorded at commit" in done.stdout

    check_each({case[1]: case for case in (*FORGED_EPISODES, *FORGED_RUNS)}, check)
    (folder / "run.json").write_bytes(whole)
    edited(folder, episode_return=record.episodes[2].episode_return + 1e-7)
    done = cli("verify", folder, "--episodes", 3)
    assert done.returncode == 0
    assert "2 identical, 1 with the same outcome and steps; recorded" in done.stdout


def test_datasets_of_the_run_are_needed():
    for changes, objects, message in (
        ({"scene_dataset": "replicaCAD"}, None, "--scene-dataset"),
        ({"objects": "ycb"}, None, "give their folder with --objects"),
        ({}, "x", "omit --objects"),
    ):
        replay = Replay(record=record_of([None], **changes), indices=(0,), objects=objects)
        with pytest.raises(OptionError, match=message):
            replay.config()


def test_verify_refuses_other_episodes_and_values(cli, stub_run):
    edited(stub_run, scene="elsewhere")
    done = cli("verify", stub_run, "--episodes", 9)
    assert done.returncode == 2
    assert 'episode "stub/002" in "elsewhere"' in done.stderr
    assert "from 0 to 8" in cli("verify", stub_run, "--episode", 9).stderr
    assert "episodes is 0" in cli("verify", stub_run, "--episodes", 0).stderr
    unknown = cli("verify", "spa_priv-pick-apartment-seed2027")
    assert "Did you mean 'spa_priv-pick-apartment-seed2026'?" in unknown.stderr


def test_film_records_the_first_success_and_the_first_failures(cli, stub_run, tmp_path):
    out = tmp_path / "videos"
    done = cli("film", stub_run, "--out", out)
    assert (done.returncode, done.stderr) == (0, "")
    # Seed 1: seeds 1000, 1001, 1002 fail by force, time out and succeed, in this order.
    stems = [f"video_{index:03d}_stub-{index:03d}" for index in range(3)]
    wanted = {f"{stem}.{suffix}" for stem in stems for suffix in ("mp4", "png")}
    assert {path.name for path in (out / "run").iterdir()} == wanted
    assert cli("film", stub_run, "--out", out, "--episode", 4).returncode == 0
    assert (out / "run" / "video_004_stub-004.mp4").is_file()
    # No video of another outcome is kept.
    edited(stub_run, steps=4)
    done = cli("film", stub_run, "--out", tmp_path / "other")
    assert done.returncode == 1
    assert "stub/002: steps: recorded 4, repeated 3" in done.stdout
    assert {path.stem for path in (tmp_path / "other" / "run").glob("*.mp4")} == set(stems[:2])
