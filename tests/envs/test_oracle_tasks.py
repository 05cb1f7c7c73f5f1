"""Scripted robots do every long task from start to end: all stages can be reached in order."""

import gymnasium as gym
import pytest
from oracle_robot import Robot
from oracles_tasks import do_task

import hab_tasks  # noqa: F401  # registers the environments

pytestmark = pytest.mark.slow

EPISODES = {"HabTidyHouse-v1": 0, "HabPrepareGroceries-v1": 1, "HabSetTable-v1": 0}
"""One of the apartment's evaluation episodes each."""


@pytest.mark.parametrize("env_id", EPISODES)
def test_an_oracle_does_the_task(env_id):
    env = gym.make(env_id, control_mode="joint_target_base", scene_dataset="apartment", split="val")
    env.reset(options={"episode": EPISODES[env_id]})
    robot = Robot(env)
    assert not any(robot.core.evaluate()["stages"].values())
    assert do_task(robot), robot.info
    assert list(robot.info["stages"]) == list(robot.core.task.stages)
    assert all(robot.info["stages"].values()), robot.info["stages"]
    assert bool(robot.info["success"])
    env.close()
