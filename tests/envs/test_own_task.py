"""User-defined skills and tasks: environments, episodes, plans and commands follow."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

import hab_tasks
from hab_tasks.errors import HabError

TESTS = Path(__file__).parents[1]
SKILL, ENV = "my_skills:Reach-v1", "my_tasks:ClearTable-v1"

SKILL_PLAY = """
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


PLAY = """
import gymnasium as gym, numpy as np, sys
env = gym.make("my_tasks:ClearTable-v1", obs_mode="state", num_episodes=2)
obs, info = env.reset(seed=0)
base = env.unwrapped
assert gym.spec("ClearTable-v1").max_episode_steps == 3000
# proprioception: 7 arm joints, 3 + 6 hand, 1 holding, 3 rest; start and goal of two objects
assert obs.shape == (1, 20 + 12), obs.shape
assert info["instruction"] == base.instruction
assert base.spec.id == "my_tasks:ClearTable-v1"
assert list(base.task.stages) == [
    "open_fridge", "pick_fruit", "place_fruit", "close_fridge", "pick_dish", "place_dish"
]
fruit, dish = base.episode[0].targets
assert fruit.object.partition("_:")[0] in ("013_apple", "017_orange")
assert dish.object.partition("_:")[0] in ("024_bowl", "025_mug")
assert fruit.goal[0].startswith("receptacle_aabb_middle_top")
for _ in range(5):
    obs, reward, terminated, truncated, info = env.step(env.action_space.sample())
assert not bool(terminated) and set(info["stages"]) == set(base.task.stages)
print(base.instruction[0])
"""

VECTOR = """
import gymnasium as gym
if __name__ == "__main__":
    envs = gym.make_vec(
        "my_tasks:ClearTable-v1", num_envs=2, num_workers=2, obs_mode="state", num_episodes=2,
    )
    obs, _ = envs.reset(seed=0)
    envs.step(envs.action_space.sample())
    envs.close()
    print(obs.shape)
"""


def run(*command):
    """Runs a command where `my_tasks` lies; returns what it printed."""
    done = subprocess.run(command, cwd=TESTS, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def script(name):
    """The path of a console script."""
    return str(Path(sys.executable).with_name(name))


@pytest.mark.slow
def test_they_are_environments():
    run(sys.executable, "-c", SKILL_PLAY)
    told = run(sys.executable, "-c", PLAY)
    assert "into the fridge" in told or "in the fridge" in told
    assert "from the light table" in told


def test_an_id_is_taken_once():
    with pytest.raises(HabError, match="HabPick-v1: another environment has this id"):
        hab_tasks.register_skill("HabPick-v1", "my_skills.reach:ReachEnv", horizon_steps=100)


@pytest.mark.slow
def test_workers_of_a_vector_environment_make_it(tmp_path):
    file = tmp_path / "vector.py"
    file.write_text(f"import sys; sys.path.append({str(TESTS)!r})\n{VECTOR}", encoding="utf-8")
    assert "2" in run(sys.executable, str(file))


def test_its_plan_is_minimal():
    code = (
        "from hab_planner import plan_of, problem_of; from hab_planner.solve import replay, solve;"
        f"plan, problem = plan_of({ENV!r}), problem_of({ENV!r});"
        "assert len(solve(problem).actions) == len(plan.actions) == 12, plan;"
        "assert replay(problem, plan)[-1] == problem.goal"
    )
    run(sys.executable, "-c", code)
    assert "place(fruit, fruit-goal, fridge)" in run(script("hab-planner"), "plan", ENV)


@pytest.mark.slow
def test_the_commands_know_them(tmp_path):
    file = tmp_path / "episodes.json"
    run(script("hab-tasks"), "episodes", "--env", ENV, "--count", "2", "--workers", "2",
        "--out", str(file))  # fmt: skip
    made = json.loads(file.read_text(encoding="utf-8"))
    assert made["env"] == "ClearTable-v1"
    assert len(made["episodes"]) == 2
    assert "light table" in run(script("hab-tasks"), "demo", ENV, "--steps", "3")
    run(script("hab-eval"), "run", "--agent", "hab_eval:do_nothing", "--env", SKILL,
        "--episodes", "2", "--out", str(tmp_path / "run"))  # fmt: skip
    record = json.loads((tmp_path / "run/run.json").read_text())
    assert record["env"] == SKILL
    assert [episode["failure"] for episode in record["episodes"]] == ["timeout", "timeout"]


@pytest.mark.long
def test_the_planner_solves_it(tmp_path):
    run(script("hab-eval"), "run", "--agent", "hab_spa:tp_spa_priv", "--env", ENV, "--episodes",
        "2", "--seed", "1", "--workers", "2", "--out", str(tmp_path / "run"))  # fmt: skip
    record = json.loads((tmp_path / "run" / "run.json").read_text(encoding="utf-8"))
    assert record["env"] == ENV
    assert [episode["success"] for episode in record["episodes"]] == [True, True]
