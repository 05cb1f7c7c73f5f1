"""The evaluator on a real environment in the embedded apartment."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from hab_eval import environments, random_agent
from hab_eval.cli import main
from hab_eval.config import EvalConfig
from hab_eval.results import read_record
from hab_eval.runner import run_episode

from hab_tasks.agent import AgentReport, AgentSetup

ROOT = Path(__file__).resolve().parents[2]
RUN = ("run", "--agent", "hab_eval:random_agent", "--env", "HabPick-v1")

pytestmark = pytest.mark.slow


def hab_eval(*arguments):
    path = os.pathsep.join([str(ROOT), str(ROOT / "eval")])
    return subprocess.run(
        [sys.executable, "-m", "hab_eval", *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=400,
    )


def episodes_of(folder):
    data = json.loads((folder / "run.json").read_text())["episodes"]
    return [{key: value for key, value in episode.items() if key != "seconds"} for episode in data]


def test_outcomes_do_not_depend_on_workers_or_on_the_episodes_before(tmp_path):
    for workers in (1, 2):
        options = ("--episodes", 3, "--seed", 1, "--workers", workers)
        done = hab_eval(*RUN, *options, "--out", tmp_path / str(workers))
        assert done.returncode == 0, done.stderr
    assert episodes_of(tmp_path / "1") == episodes_of(tmp_path / "2")
    record = read_record(tmp_path / "1" / "run.json")
    assert (record.env, record.scene_dataset, record.seed) == ("HabPick-v1", "apartment", 1)
    assert not record.privileged
    assert all(0 < episode.steps <= 200 for episode in record.episodes)
    assert {"python", "hab-tasks", "mani-skill", "sapien"} <= record.versions.keys()
    # The last episode alone, after a cut, ends as it did after the two before it.
    journal = tmp_path / "1" / "episodes.jsonl"
    journal.write_text("".join(journal.read_text().splitlines(keepends=True)[:2]))
    before = episodes_of(tmp_path / "1")
    options = ("--episodes", 3, "--seed", 1, "--resume")
    assert hab_eval(*RUN, *options, "--out", tmp_path / "1").returncode == 0
    assert episodes_of(tmp_path / "1") == before


@pytest.mark.parametrize(
    ("option", "value", "expected"),
    [
        ("--env", "HabPik-v1", "Did you mean 'HabPick-v1'?"),
        ("--scene-dataset", "apartmnt", "apartmnt"),
        ("--split", "vall", "vall"),
    ],
)
def test_bad_names(tmp_path, capsys, option, value, expected):
    assert main([*RUN, option, value, "--out", str(tmp_path / "run")]) == 2
    told = capsys.readouterr().err
    assert expected in told
    assert "Traceback" not in told
    assert not (tmp_path / "run").exists()


def test_a_task_that_times_out_has_the_agents_category():
    """No task names a failure of its own, so that what the agent says is kept."""
    config = EvalConfig(agent="hab_eval:random_agent", env="HabPrepareGroceries-v1", episodes=1)
    (episode,) = environments.load_episode_set(config, None, 1).episodes
    agent = random_agent(AgentSetup(env_id=config.env))
    agent.report = lambda: [AgentReport(failure="target plan")]  # pyright: ignore[reportAttributeAccessIssue]
    env = environments.make_env(config, agent.spec, split="val", render=False)
    result = run_episode(env, agent, 0, episode).episode
    env.close()
    assert result.steps == 4000
    assert not result.success
    assert result.failure == "target plan"


def test_the_environment_tells_what_the_agent_asked_for():
    config = EvalConfig(agent="hab_eval:random_agent", env="HabOpenDrawer-v1", episodes=1)
    spec = random_agent(AgentSetup(env_id=config.env)).spec
    asked = {
        replace(spec, handle_position=True): {"object_start_from_ee", "handle_from_ee"},
        replace(spec, target_frame="ee"): {"object_start_in_ee"},
    }
    for one, entries in asked.items():
        env = environments.make_env(config, one, split="val", render=False)
        obs, _ = env.reset(seed=0)
        assert obs["extra"].keys() == entries
        env.close()


@pytest.mark.render
def test_video_is_made_and_changes_nothing(tmp_path):
    out = tmp_path / "run"
    run = ("run", "--agent", "hab_eval:random_agent", "--env", "HabOpenFridge-v1", "--episodes", 1)
    run = (*run, "--seed", 4)  # the robot leaves its region after 66 steps
    done = hab_eval(*run, "--video", 1, "--out", out)
    assert done.returncode == 0, done.stderr
    assert hab_eval(*run, "--out", tmp_path / "dark").returncode == 0
    (episode,) = episodes_of(out)
    assert [episode] == episodes_of(tmp_path / "dark")
    assert episode["failure"] == "left_region"
    (video,) = out.glob("video_*.mp4")
    assert video.stat().st_size > 10_000
    (still,) = out.glob("video_*.png")
    assert still.stat().st_size > 10_000


@pytest.mark.long
@pytest.mark.assets
@pytest.mark.render
def test_bench(tmp_path, replica_cad, ycb):
    rows = tmp_path / "rows.json"
    data = ("--scene-dataset", replica_cad, "--objects", ycb)
    options = ("--scene", "v3_sc0_staging_00", "--repeats", 1, "--steps", 20, "--json", rows)
    done = hab_eval("bench", "--suite", "sim", *data, *options)
    assert done.returncode == 0, done.stderr
    found = {row["name"]: row for row in json.loads(rows.read_text())["rows"]}
    speed = found["sim/v3_sc0_staging_00/HabPick-v1/ee"]
    assert speed["ratio"] == pytest.approx(speed["value"] / speed["reference_value"])
    assert 0 < found["sim/v3_sc0_staging_00/HabPick-v1/ee_physics_share"]["value"] < 1
