"""A user-defined skill is one file and one registration: environment, episodes, evaluation."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

import hab_tasks
from hab_tasks.errors import HabError

TESTS = Path(__file__).parents[1]
ENV = "my_skills:Reach-v1"

PLAY = """
import gymnasium as gym
env = gym.make(
    "my_skills:Reach-v1", obs_mode="state", reward_mode="normalized_dense", num_episodes=2,
    skill_config={"near_m": 9.0},
)
obs, info = env.reset(seed=0)
assert obs.shape == (1, 20 + 3), obs.shape  # as Pick's: proprioception and the object
assert info["instruction"][0].startswith("Reach for the "), info["instruction"]
action = env.action_space.sample() * 0.0
obs, reward, terminated, truncated, info = env.step(action)
assert bool(terminated) and bool(info["success"])  # the hand is within 9 m
# The arm holds its pose: 5 for success, of a bound of 5 + 0.25 x 10 = 7.5
assert abs(float(reward) - 5.0 / 7.5) < 0.01, reward
"""


def run(*command):
    """Runs a command where `my_skills` lies."""
    done = subprocess.run(command, cwd=TESTS, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def script(name):
    return str(Path(sys.executable).with_name(name))


def test_it_is_an_environment_with_its_own_weights():
    run(sys.executable, "-c", PLAY)


@pytest.mark.slow
def test_the_commands_know_it(tmp_path):
    out = tmp_path / "reach.json"
    run(script("hab-tasks"), "episodes", "--env", ENV, "--count", "2", "--out", str(out))
    assert len(json.loads(out.read_text())["episodes"]) == 2
    run(
        *(script("hab-eval"), "run", "--agent", "hab_eval:do_nothing", "--env", ENV),
        *("--episodes", "2", "--out", str(tmp_path / "run")),
    )
    record = json.loads((tmp_path / "run/run.json").read_text())
    assert record["env"] == ENV
    assert [episode["failure"] for episode in record["episodes"]] == ["timeout", "timeout"]


def test_an_id_is_taken_once():
    with pytest.raises(HabError, match="HabPick-v1: another environment has this id"):
        hab_tasks.register_skill("HabPick-v1", "my_skills.reach:ReachEnv", horizon_steps=100)
