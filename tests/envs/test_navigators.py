"""Navigators: shortest path, teleport, and another agent."""

import math

import hab_spa
import numpy as np
import pytest
import torch
from hab_spa import spa_priv
from hab_spa.motion.drive import DriveConfig, _before, drive_to
from hab_spa.motion.robot import Robot, SpaConfig
from hab_spa.motion.wheels import angle
from hab_spa.results import Failure
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.tasks.navigate import (
    NavigationRequest,
    PolicyNavigator,
    navigator_of,
    observation,
    teleport,
)
from hab_spa.tasks.standing import TUCKED_QPOS_RAD, Standing, fold

from hab_tasks.agent import AgentReport, AgentSetup, AgentSpec
from hab_tasks.arrays import to_tensor
from hab_tasks.engine.sensors import POINT
from hab_tasks.errors import HabError
from hab_tasks.navigation import NavigationMap
from hab_tasks.privileged import CollisionBody, CollisionShape

SETUP = AgentSetup(env_id="HabTidyHouse-v1")


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
        scene = TrueScene()
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


def test_the_base_drives_to_its_goal_and_stops_there(started):
    _, robot, run = started("HabNavigate-v1", "base", 1)
    goal = robot.scene.state.base_goal
    config = DriveConfig()
    failure = run(
        drive_to(robot, robot.scene.floor_map(), goal, config), lambda c: np.array(c.base)
    )
    assert failure is None
    assert np.linalg.norm(robot.base[:2] - goal[:2]) < 2 * config.arrived_m
    assert abs(angle(goal[2], robot.base[2])) < 2 * config.arrived_rad
    assert bool(run.info["success"])


def test_no_time_is_an_execution_failure(started):
    _, robot, run = started("HabNavigate-v1", "base")
    robot.deadline = 20
    map_ = robot.scene.floor_map()
    failure = run(
        drive_to(robot, map_, robot.scene.state.base_goal, DriveConfig()),
        lambda c: np.array(c.base),
    )
    assert failure is Failure.EXECUTION
    assert robot.steps < 60


def joint_targets(command):
    return np.concatenate((command.arm_rad, [command.gripper], command.base))


def navigation_request(robot, pose, point_m=(1.0, 2.0, 0.5)):
    """To a base pose, the arm as it is."""
    standing = None if pose is None else Standing(base=pose, arm_rad=robot.scene.arm_qpos)
    return NavigationRequest(
        point_m=np.array(point_m), map=robot.scene.floor_map(), choose_base_pose=lambda: standing
    )


def test_teleport_is_there_at_once(started):
    _, robot, run = started("HabTidyHouse-v1", "joint_target_pose")
    x, y = robot.scene.floor_map().nearest_free(robot.base[:2] + 1.0)
    goal = np.array((x, y, 1.0))

    def entries(command):
        pose = robot.base if command.pose is None else command.pose
        return np.concatenate((command.arm_rad, [command.gripper], pose))

    assert run(teleport(robot, navigation_request(robot, goal)), entries) is None
    np.testing.assert_allclose(robot.base, goal, atol=0.01)
    assert robot.steps < 10


def test_the_folded_arm_stays_over_the_base_and_a_robot_folds_it_first(started):
    env, robot, run = started("HabTidyHouse-v1", "joint_target_base")
    folded = np.array(TUCKED_QPOS_RAD)
    assert run(fold(robot, Standing(base=robot.base, arm_rad=folded)), joint_targets) is None
    np.testing.assert_allclose(robot.scene.arm_qpos, folded, atol=0.05)
    # Navigation takes the robot for a disc of 0.3 m; what the hand holds may stick out a little.
    ee_m = robot.kinematics.ee_pose(robot.scene.arm_qpos)[:2, 3]
    assert np.linalg.norm(ee_m) < 0.25
    assert robot.scene.collision().is_free(folded)
    assert float(env.unwrapped.measures.force_n[0]) == 0.0


def test_nowhere_to_stand_is_a_target_plan_failure(started):
    _, robot, run = started("HabTidyHouse-v1", "joint_target_pose")
    nowhere = NavigationRequest(
        point_m=np.zeros(3), map=robot.scene.floor_map(), choose_base_pose=lambda: None
    )
    assert run(teleport(robot, nowhere), None) is Failure.TARGET_PLAN
    assert robot.steps == 0


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

    assert run(navigator(robot, navigation_request(robot, None)), entries) is None
    assert turns == [(0.0, 1.0), (0.0, 1.0), (0.0, 0.0)]
    assert angle(robot.base[2], before[2]) > 0.05


@pytest.mark.parametrize("frame", ["base", "ee"])
def test_its_observation_is_that_of_navigate(started, frame):
    env, robot, _ = started("HabNavigate-v1", "base")
    goals = env.unwrapped._simulation.goals
    told = observation(robot, np.asarray(goals.goals_m[0, 0], dtype=float), frame)
    if frame == "base":
        extra = robot.obs["extra"]
    else:
        entry = POINT.in_ee
        extra = {entry.name: to_tensor(entry.read(env.unwrapped._simulation.snapshot, None, goals))}
    for group, expected in {"agent": robot.obs["agent"], "extra": extra}.items():
        assert told[group].keys() == expected.keys()
        for name, value in expected.items():
            torch.testing.assert_close(told[group][name], value, atol=1e-4, rtol=0.0)


def test_a_planner_has_the_images_that_its_navigator_needs():
    expected = {
        "oracle": ("state_dict", "always"),
        "hab_ppo:navigator_once": ("depth", "on demand"),
    }
    for navigation, images in expected.items():
        setup = AgentSetup(env_id="HabTidyHouse-v1", options={"navigation": navigation})
        spec = hab_spa.tp_spa_priv(setup).spec
        assert (spec.obs_mode, spec.looks) == images
    with pytest.raises(HabError, match="flying"):
        navigator_of(AgentSetup(env_id="HabTidyHouse-v1", options={"navigation": "flying"}))
    assert spa_priv(AgentSetup(env_id="hab_tasks:HabNavigate-v1")).spec.control_mode == "base"


def turning_room(*boxes):
    """A map of 6 x 6 m of floor with boxes ((x, y), (x, y)) on it, 2 m high."""
    found = []
    for number, (low, high) in enumerate((((0, 0), (6, 6)), *boxes)):
        below, above = (-0.1, 0.0) if number == 0 else (0.0, 2.0)
        lower, upper = np.array((*low, below)), np.array((*high, above))
        middle = np.eye(4)
        middle[:3, 3] = (lower + upper) / 2
        shape = CollisionShape(
            kind="box",
            body_from_shape=middle,
            half_size_m=(upper - lower) / 2,
            vertices_m=np.zeros((0, 3)),
            faces=np.zeros((0, 3), dtype=np.int64),
        )
        group = "stage" if number == 0 else "static"
        found.append(CollisionBody(name=str(number), group=group, shapes=(shape,)))
    return NavigationMap.of_bodies(found, {body.name: np.eye(4) for body in found})


def test_an_arm_that_sticks_out_turns_where_it_has_room():
    # The goal looks to the north, with a wall 0.45 m to the east of it, so that straight behind it
    # there is no room for a hand at 0.65 m. From the south-west there is.
    map_, goal = turning_room(((3.45, 0), (3.6, 6))), np.array((3.0, 3.0, math.pi / 2))
    folded = _before(map_, goal, DriveConfig())
    np.testing.assert_allclose(folded, (3.0, 3.0 - 0.35, math.pi / 2), atol=1e-9)
    x, y, yaw_rad = _before(map_, goal, DriveConfig(turning_m=0.65))
    assert map_.clearance_m(np.array((x, y))) >= 0.65
    assert x <= 3.45 - 0.65
    assert y < 3.0
    assert angle(yaw_rad, math.atan2(3.0 - y, 3.0 - x)) == pytest.approx(0.0, abs=1e-9)


def test_where_nothing_has_room_an_arm_that_sticks_out_turns_behind_the_goal():
    corridor = turning_room(((0, 0), (2.45, 6)), ((3.55, 0), (6, 6)))
    goal = np.array((3.0, 3.0, math.pi / 2))
    found = _before(corridor, goal, DriveConfig(turning_m=0.65))
    np.testing.assert_allclose(found, (3.0, 3.0 - 0.35, math.pi / 2), atol=1e-9)
