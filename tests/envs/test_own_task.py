"""User-defined skills and tasks: environments, workers and plans follow.

The tutorials, of which the task is one's, run the commands.
"""

import json
import os
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import gymnasium as gym
import pytest
from hab_plans import plan_of, problem_of
from hab_plans.solve import replay, solve
from playing import long, slow
from refusals import refused_by_call

import hab_tasks

TESTS = Path(__file__).parents[1]
ENV = "my_tasks:ClearTable-v1"


@slow
def test_a_skill_is_an_environment():
    options = {"reward_mode": "normalized_dense", "skill_config": {"near_m": 9.0}}
    env = gym.make("my_skills:Reach-v1", obs_mode="state", num_episodes=2, **options)
    obs, info = env.reset(seed=0)
    assert obs.shape == (1, 20 + 3)  # as Pick's: proprioception and the object
    assert info["instruction"][0].startswith("Reach for the ")
    _, reward, terminated, _, info = env.step(0.0 * env.action_space.sample())
    assert terminated
    assert info["success"]  # the hand is within 9 m
    # The arm holds its pose: 5 for success, of a bound of 5 + 0.25 x 10 = 7.5
    assert float(reward) == pytest.approx(5.0 / 7.5, abs=0.01)
    env.close()


@slow
def test_a_task_is_an_environment_also_in_workers():
    env = gym.make(ENV, obs_mode="state", num_episodes=2)
    obs, info = env.reset(seed=0)
    assert gym.spec("ClearTable-v1").max_episode_steps == 3000
    # proprioception: 7 arm joints, 3 + 6 hand, 1 holding, 3 rest; start and goal of two objects
    assert obs.shape == (1, 20 + 12)
    names = ["open_fridge", "pick_fruit", "place_fruit", "close_fridge", "pick_dish", "place_dish"]
    assert list(env.unwrapped.task.stages) == names
    fruit, dish = env.unwrapped.episode[0].targets
    assert fruit.object.partition("_:")[0] in ("013_apple", "017_orange")
    assert dish.object.partition("_:")[0] in ("024_bowl", "025_mug")
    assert fruit.goal[0].startswith("receptacle_aabb_middle_top")
    assert "from the light table" in info["instruction"][0]
    _, _, terminated, _, info = env.step(env.action_space.sample())
    assert not terminated
    assert list(info["stages"]) == names
    env.close()
    with closing(gym.make_vec(ENV, num_envs=2, num_workers=2, num_episodes=2)) as envs:
        assert envs.reset(seed=0)[0].shape == (2, 32)
        envs.step(envs.action_space.sample())


SCRIPT = """
import gymnasium, hab_tasks
from my_tasks import CLEAR_TABLE as task
if __name__ == "__main__":
    task = hab_tasks.TaskSpec(**{**vars(task), "id": "Here-v1", "targets": list(task.targets)})
    hab_tasks.register_task(task, __name__)
    gymnasium.make("Here-v1", num_episodes=1).reset(seed=0)
    envs = gymnasium.make_vec("Here-v1", num_envs=2, num_workers=2, num_episodes=1)
    assert envs.reset(seed=0)[0].shape == (2, 32)
    envs.close()
"""


@slow
def test_a_script_declares_a_task_also_for_its_workers(tmp_path):
    """As a file; piped, where Python's workers look in vain for a file; and without a guard."""
    file = tmp_path / "script.py"
    for text, piped, code in (
        (SCRIPT, True, 0),
        (SCRIPT, False, 0),
        (SCRIPT.replace("__name__ ==", "__name__ and"), False, 1),
    ):
        file.write_text(text)
        command = (sys.executable, "-" if piped else str(file))
        path = {**os.environ, "PYTHONPATH": str(TESTS)}
        done = subprocess.run(command, input=text, capture_output=True, text=True, env=path)
        assert done.returncode == code, done.stderr
        assert code == 0 or "`if __name__ == '__main__':`." in done.stderr.splitlines()[-1]


def test_an_id_is_taken_once():
    arguments = ("HabPick-v1", "my_skills.reach:ReachEnv")
    words = "HabPick-v1: another environment has this id"
    refused_by_call(lambda: hab_tasks.register_skill(*arguments, horizon_steps=100), words)


def test_its_plan_is_minimal():
    plan, problem = plan_of(ENV), problem_of(ENV)
    assert len(solve(problem).actions) == len(plan.actions) == 12
    assert replay(problem, plan)[-1] == problem.goal


@long
def test_the_planner_solves_it(tmp_path):
    options = f"--env {ENV} --episodes 2 --seed 1 --workers 2 --out {tmp_path}/run"
    command = f"{Path(sys.executable).parent}/hab-eval run --agent hab_spa:tp_spa_priv {options}"
    subprocess.run(command.split(), cwd=TESTS, check=True)
    record = json.loads((tmp_path / "run" / "run.json").read_text(encoding="utf-8"))
    assert [episode["success"] for episode in record["episodes"]] == [True, True]
