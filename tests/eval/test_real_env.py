"""The evaluator on a real environment in the embedded apartment."""

import json
import math
from dataclasses import replace

import imageio.v2 as imageio
import numpy as np
import pytest
from hab_eval import random_agent
from hab_eval.cli import main
from hab_eval.records.config import EvalConfig
from hab_eval.records.results import read_record
from hab_eval.run import environments
from hab_eval.run.observations import AgentView
from hab_eval.run.runner import run_episode
from stub_runs import results_of

from hab_tasks.agent import AgentReport, AgentSetup
from hab_tasks.agent_spaces import agent_spaces

RUN = ("run", "--agent", "hab_eval:random_agent", "--env", "HabPick-v1")

pytestmark = pytest.mark.slow


def run(*arguments):
    assert main([*map(str, arguments)]) == 0


def test_outcomes_do_not_depend_on_workers_or_on_the_episodes_before(tmp_path):
    options = (*RUN, "--episodes", 3, "--seed", 1)
    for workers in (1, 2):
        run(*options, "--workers", workers, "--out", tmp_path / str(workers))
    alone = results_of(tmp_path / "1")
    assert results_of(tmp_path / "2") == alone
    record = read_record(tmp_path / "1" / "run.json")
    assert (record.env, record.scene_dataset, record.seed) == ("HabPick-v1", "apartment", 1)
    assert not record.privileged
    assert all(0 < episode.steps <= 200 for episode in record.episodes)
    assert {"python", "hab-tasks", "mani-skill", "sapien"} <= record.versions.keys()
    # The last episode alone, after a cut, ends as it did after the two before it.
    journal = tmp_path / "1" / "episodes.jsonl"
    journal.write_text("".join(journal.read_text().splitlines(keepends=True)[:2]))
    run(*options, "--resume", "--out", tmp_path / "1")
    assert results_of(tmp_path / "1") == alone


@pytest.mark.parametrize("agent", ["hab_eval:straight_line", "hab_spa:spa_priv"])
def test_an_isolated_agent_wins_as_in_the_same_process(agent, tmp_path):
    command = ("run", "--agent", agent, "--env", "HabPick-v1", "--episodes", 1, "--seed", 11)
    run(*command, "--out", tmp_path / "same")
    run(*command, "--isolated", "--out", tmp_path / "own")
    assert results_of(tmp_path / "own") == results_of(tmp_path / "same")
    assert results_of(tmp_path / "own")[0]["success"]


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
        replace(
            spec,
            targets="language",
            instruction="stage",
            obs_mode="depth",
            cameras=("third_person",),
            camera_size_px=32,
            camera_hfov_rad=1.0,
        ): set(),
    }
    for one, entries in asked.items():
        env = environments.make_env(config, one, split="val", render=False)
        obs = AgentView(one)(env, env.reset(seed=0)[0])
        assert obs.get("extra", {}).keys() == entries
        if one.instruction:
            assert obs["instruction"] == ["Open the drawer."]
            assert obs["sensor_data"]["third_person"]["depth"].shape == (1, 32, 32, 1)
            focal_px = obs["sensor_param"]["third_person"]["intrinsic_cv"][0, 0, 0]
            assert focal_px == pytest.approx(16 / math.tan(0.5))
            told = agent_spaces(config.env, one).observation
            assert env.unwrapped.single_observation_space == told
        env.close()


@pytest.mark.render
def test_video_is_made_and_changes_nothing(tmp_path):
    command = ("run", "--agent", "hab_eval:random_agent", "--env", "HabOpenFridge-v1")
    command += ("--episodes", 1, "--seed", 4)  # the robot leaves its region after 66 steps
    run(*command, "--video", 1, "--out", tmp_path / "run")
    run(*command, "--out", tmp_path / "dark")
    (episode,) = results_of(tmp_path / "run")
    assert [episode] == results_of(tmp_path / "dark")
    assert episode["failure"] == "left_region"
    for suffix in ("mp4", "png"):
        (video,) = (tmp_path / "run").glob(f"video_*.{suffix}")
        assert video.stat().st_size > 10_000
    # After the first frame and one for each step, the last one is held for 1 s.
    frames = list(imageio.get_reader(video.with_suffix(".mp4")).iter_data())
    assert len(frames) == 1 + episode["steps"] + 30
    assert np.ptp(np.stack(frames[-29:]).astype(int), axis=0).mean() < 1


@pytest.mark.long
@pytest.mark.assets
@pytest.mark.render
def test_bench(tmp_path, replica_cad, ycb):
    rows = tmp_path / "rows.json"
    data = ("--scene-dataset", replica_cad, "--objects", ycb)
    options = ("--scene", "v3_sc0_staging_00", "--repeats", 1, "--steps", 20, "--json", rows)
    run("bench", "--suite", "sim", *data, *options)
    found = {row["name"]: row for row in json.loads(rows.read_text())["rows"]}
    speed = found["sim/v3_sc0_staging_00/HabPick-v1/ee"]
    assert speed["ratio"] == pytest.approx(speed["value"] / speed["reference_value"])
    assert 0 < found["sim/v3_sc0_staging_00/HabPick-v1/ee_physics_share"]["value"] < 1
