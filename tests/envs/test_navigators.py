"""Navigators: shortest path, driven and perfect, and another agent."""

import math

import numpy as np
import pytest
import torch
from builders import same
from hab_plans.motion import Failure
from hab_plans.plan import plan_of
from hab_plans.problem import task_of
from hab_plans.protocols import BasePose, NavigationRequest
from hab_plans.stage import stage_of
from hab_spa.agents.agent import driven
from hab_spa.motion.drive import DriveConfig, angle, drive_to
from hab_spa.motion.moves import tucked_rad
from hab_spa.motion.robot import Robot, SpaConfig
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.tasks.navigate import OracleNavigator, PolicyNavigator, navigator_of, observation
from hab_spa.tasks.planned_skills import fold

from hab_tasks.agent import AgentReport, AgentSetup, AgentSpec
from hab_tasks.arrays import to_tensor
from hab_tasks.engine.sensors import POINT
from hab_tasks.robots.fetch import FETCH


def test_angle_is_the_shorter_turn():
    assert angle(1.0, 0.5) == pytest.approx(0.5)
    assert angle(3.0, -3.0) == pytest.approx(6.0 - 2 * math.pi)
    assert angle(-3.0, 3.0) == pytest.approx(2 * math.pi - 6.0)


@pytest.fixture
def started(make):
    """Starts an episode; returns env and robot, and a function that goes on until a motion ends."""

    def start(env_id, mode, index=0):
        env = make(env_id, control_mode=mode, obs_mode="state_dict")
        obs, _ = env.reset(options={"episode": index})
        scene = TrueScene(FETCH)
        seen = {**obs, "privileged": env.unwrapped.privileged()}
        scene.see(seen, 0)
        robot = Robot(scene, SpaConfig(), seed=0, deadline=500)
        robot.obs = seen

        def run(motion, entries):
            while True:
                try:
                    command = next(motion)
                except StopIteration as end:
                    return end.value
                obs, _, _, _, info = env.step(entries(command).astype(np.float32))
                robot.steps += 1
                robot.obs = {**obs, "privileged": env.unwrapped.privileged()}
                scene.see(robot.obs, 0)
                run.info = info

        return env, robot, run

    return start


def test_the_base_drives_to_its_goal_and_stops_there_if_it_has_the_time(started):
    _, robot, run = started("HabNavigate-v1", "base", 1)
    goal, config = robot.scene.state.base_goal, DriveConfig()
    way = drive_to(robot, robot.scene.floor_map(), goal, config)
    assert run(way, lambda c: np.array(c.base)) is None
    assert np.linalg.norm(robot.base[:2] - goal[:2]) < 2 * config.arrived_m
    assert abs(angle(goal[2], robot.base[2])) < 2 * config.arrived_rad
    assert bool(run.info["success"])
    _, robot, run = started("HabNavigate-v1", "base")
    robot.deadline = 20
    way = drive_to(robot, robot.scene.floor_map(), robot.scene.state.base_goal, config)
    assert run(way, lambda c: np.array(c.base)) is Failure.EXECUTION
    assert robot.steps < 60


def joint_targets(command):
    return np.concatenate((command.arm_rad, [command.gripper], command.base))


def request_to(robot, pose):
    """To a base pose, the arm as it is."""
    chosen = None if pose is None else BasePose(base=pose, arm_rad=robot.scene.arm_qpos)
    stage = stage_of(task_of("HabTidyHouse-v1"), plan_of("HabTidyHouse-v1").interactions[0])
    return NavigationRequest(stage=stage, tried=(), choose_base_pose=lambda: chosen)


def test_perfect_navigation_is_the_oracles_way_in_base_poses(started):
    _, robot, run = started("HabTidyHouse-v1", "joint_target_pose")
    x, y = robot.scene.floor_map().nearest_free(robot.base[:2] + 1.0)
    goal = np.array((x, y, 1.0))

    def entries(command):
        pose = driven(FETCH, robot.base, *command.base)
        return np.concatenate((command.arm_rad, [command.gripper], pose))

    assert run(OracleNavigator().go(robot, request_to(robot, None)), None) is Failure.TARGET_PLAN
    assert robot.steps == 0
    assert run(OracleNavigator().go(robot, request_to(robot, goal)), entries) is None
    np.testing.assert_allclose(robot.base, goal, atol=DriveConfig().arrived_rad)
    # 1.4 m take 42 steps of 1/30 m, and the turns as many.
    assert 42 < robot.steps < 200


def test_the_folded_arm_stays_over_the_base_and_a_robot_folds_it_first(started):
    env, robot, run = started("HabTidyHouse-v1", "joint_target_base")
    folded = tucked_rad(FETCH)
    assert run(fold(robot, BasePose(base=robot.base, arm_rad=folded)), joint_targets) is None
    np.testing.assert_allclose(robot.scene.arm_qpos, folded, atol=0.05)
    # Navigation takes the robot for a disc of 0.3 m; what the hand holds may stick out a little.
    ee_m = robot.kinematics.ee_pose(robot.scene.arm_qpos)[:2, 3]
    assert np.linalg.norm(ee_m) < 0.25
    assert robot.scene.collision().is_free(folded)
    assert float(env.unwrapped.measures.force_n[0]) == 0.0


class Wheels:
    """An agent for Navigate that turns twice, and stops."""

    def __init__(self, setup):
        assert setup.env_id == "HabNavigate-v1"
        assert dict(setup.options) == {"policy": "weights.safetensors"}
        self.spec, self.seen = AgentSpec(name="wheels", control_mode="base_discrete"), []

    def reset(self, mask, seeds):
        self.seen = []

    def act(self, obs):
        self.seen.append(obs)
        # Cells: forward -0.5, 0, 0.5, 1 in rows, turn -1, -0.5, 0, 0.5, 1 in columns.
        return torch.tensor([[9.0 if len(self.seen) < 3 else 7.0]])

    def report(self):
        return [AgentReport()]


def test_another_agent_drives_until_it_stops(started, monkeypatch):
    import hab_eval

    monkeypatch.setattr(hab_eval, "wheels", Wheels, raising=False)
    options = {"navigation": "hab_eval:wheels", "policy": "weights.safetensors", "replan": "0"}
    navigator = navigator_of(AgentSetup(env_id="HabTidyHouse-v1", options=options))
    assert isinstance(navigator, PolicyNavigator)
    _, robot, run = started("HabTidyHouse-v1", "joint_target_base")
    before = robot.base
    turns = []

    def entries(command):
        turns.append(command.base)
        return joint_targets(command)

    assert run(navigator.go(robot, request_to(robot, None)), entries) is None
    assert turns == [(0.0, 1.0), (0.0, 1.0), (0.0, 0.0)]
    assert angle(robot.base[2], before[2]) > 0.05


@pytest.mark.parametrize("frame", ["base", "ee"])
def test_its_observation_is_that_of_navigate(started, frame):
    env, robot, _ = started("HabNavigate-v1", "base")
    goals = env.unwrapped.simulation.goals
    told = observation(robot, np.asarray(goals.goals_m[0, 0], dtype=float), frame)
    if frame == "base":
        extra = robot.obs["extra"]
    else:
        entry = POINT.in_ee
        extra = {entry.name: to_tensor(entry.read(env.unwrapped.simulation.snapshot, None, goals))}
    expected = {"agent": robot.obs["agent"], "extra": extra}
    assert same({group: told[group] for group in expected}, expected, atol=1e-4)
