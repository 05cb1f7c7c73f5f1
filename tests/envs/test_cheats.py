"""Scripted cheats: what they win, they win by moving as a robot can."""

import gymnasium as gym
import numpy as np
import pytest

from hab_tasks.constants import REST_RADIUS_M
from hab_tasks.robots.arm_commands import ee_step_m
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.robots.robot import ROBOT

EPISODES = 20
REST_RAD = np.array(ROBOT.rest_qpos_rad)
KINEMATICS = ArmKinematics()


def arm_at(snapshot, point_m):
    """The arm pose (7,) with the end-effector at a point in the world, if there is one."""
    x, y, yaw = snapshot.base[0]
    ahead, side = np.cos(yaw), np.sin(yaw)
    way = np.subtract(point_m, (x, y, ROBOT.base_height_m))
    goal = np.array([ahead * way[0] + side * way[1], ahead * way[1] - side * way[0], way[2]])
    return KINEMATICS.approach(snapshot.arm_qpos_rad[0].astype(float), goal, 60, 0.02)


def episodes(env_id, mode):
    """Starts test episodes in turn; yields the environment."""
    options = {"num_episodes": EPISODES, "split": "test", "episode_seed": 7}
    env = gym.make(f"hab_tasks:{env_id}", control_mode=mode, obs_mode="state", **options)
    for number in range(EPISODES):
        env.reset(seed=number, options={"episode": number})
        yield env
    env.close()


@pytest.mark.long
@pytest.mark.parametrize("below_m", [0.0, 0.12])
@pytest.mark.parametrize("mode", ["joint_state", "joint_target"])
def test_nobody_picks_faster_than_the_arm_moves(mode, below_m):
    for env in episodes("HabPick-v1", mode):
        simulation = env.unwrapped.simulation
        snapshot = simulation.snapshot
        # To within grasping distance and, to rest, back; stretched, the arm is faster than at rest.
        way_m = np.linalg.norm(snapshot.objects_m[0, 0] - snapshot.ee_m[0]) - 0.15
        least_steps = max(2 * way_m - REST_RADIUS_M, 0.0) / (1.5 * ee_step_m(mode))
        for _ in range(200):
            snapshot = simulation.snapshot
            aim_m = snapshot.objects_m[0, 0] - (0.0, 0.0, below_m)
            arm = REST_RAD if snapshot.held[0] >= 0 else arm_at(snapshot, aim_m)
            *_, terminated, _, info = env.step(np.append(arm, 1.0).astype(np.float32))
            if terminated:
                break
        assert not info["success"] or env.unwrapped.measures.steps[0] >= least_steps


@pytest.mark.long
@pytest.mark.parametrize("way", ["thrown", "from below"])
def test_what_counts_as_placed_still_lies_there_two_seconds_later(way):
    placed = 0
    for env in episodes("HabPlace-v1", "joint_target"):
        simulation = env.unwrapped.simulation
        goal_m = simulation.goals.goals_m[0, 0]
        for step in range(200):
            snapshot = simulation.snapshot
            object_m = snapshot.objects_m[0, 0]
            gap_m, arm, gripper = np.linalg.norm(object_m - goal_m), REST_RAD, -1.0
            if snapshot.held[0] >= 0:
                offset_m = (0.0, 0.0, 0.1 if way == "thrown" else -0.13)
                arm = arm_at(snapshot, goal_m + snapshot.ee_m[0] - object_m + offset_m)
                low = object_m[2] < goal_m[2] - 0.05
                lets_go = gap_m < 0.28 if way == "thrown" else (gap_m < 0.145 and low) or step > 100
                gripper = -1.0 if lets_go else 1.0
            *_, ended, _, _ = env.step(np.append(arm, gripper).astype(np.float32))
            if env.unwrapped.measures.placed[0]:
                placed += 1
                for _ in range(60):
                    simulation.simulate(np.float32([-1.0]), 4)
                simulation.read_snapshot(np.zeros(1, np.float32))
                assert np.linalg.norm(simulation.snapshot.objects_m[0, 0] - goal_m) < 0.15
                break
            if ended:
                break
    assert placed > EPISODES / 4
