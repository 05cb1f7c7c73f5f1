"""Timing, path following, skills in closed loop, and the agent."""

import numpy as np
import pytest
import torch
from hab_spa import Failure, spa_priv
from hab_spa.motion.follow import FollowConfig, Follower
from hab_spa.motion.robot import RELEASE, Robot, SpaConfig
from hab_spa.planning.path import TimingConfig, time_path
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.skills.pick import pick
from hab_spa.skills.place import place, place_score

from hab_tasks.agent import Agent, AgentSetup
from hab_tasks.constants import REST_POSITION_M
from hab_tasks.robots.robot import ROBOT

REST = np.array(ROBOT.rest_qpos_rad)
CORNER = np.array([np.zeros(7), np.eye(7)[0], np.eye(7)[0] + np.eye(7)[1] * 0.5])
STEPS = 200


def robot_in(state, seed=0):
    """Returns a robot that has seen a state."""
    scene = TrueScene()
    scene.see({"privileged": [state]}, 0)
    return Robot(scene, SpaConfig(), seed=seed, deadline=STEPS)


def carry_out(robot, motion, step):
    """Does a skill; `step` takes a command and returns the state after it.

    Returns the commands and what the skill returned; fails when it takes too long.
    """
    commands = []
    for _ in range(STEPS):
        try:
            commands.append(next(motion))
        except StopIteration as end:
            return commands, end.value
        robot.steps += 1
        robot.scene.see({"privileged": [step(commands[-1])]}, 0)
    return pytest.fail(f"not over after {STEPS} steps")


def test_targets_stay_on_the_path_within_limits_of_step_and_acceleration():
    config = TimingConfig()
    targets = np.concatenate((CORNER[:1], time_path(CORNER, config)))
    np.testing.assert_allclose(targets[-1], CORNER[-1])
    assert np.all(np.isclose(targets[:, 1], 0.0) | np.isclose(targets[:, 0], 1.0))
    steps = np.abs(np.diff(targets, axis=0)).max(axis=1)
    assert 0.9 * config.step_rad < steps.max() <= config.step_rad + 1e-9
    # Slow at both ends and at the corner, where the whole speed changes its direction.
    corner = int(np.argmax(targets[:, 1] > 0))
    assert max(steps[0], steps[-1], steps[corner]) < 0.7 * config.step_rad
    # A path without length has one target.
    np.testing.assert_array_equal(time_path(np.stack((REST, REST)), config), REST[None])


def test_follower_waits_for_a_late_arm_and_notices_a_lost_one():
    targets = np.linspace(0.0, 1.0, 21)[1:, None] * np.ones(7)
    config = FollowConfig()
    follower = Follower(targets, config)
    stuck = np.zeros(7)
    for _ in range(10):
        follower.advance(stuck)
    # 0.05 rad a step: after 0.25 rad the target waits.
    assert follower.target.max() == pytest.approx(config.lag_rad + 0.05)
    assert not follower.lost()
    for _ in range(config.lost_steps):
        follower.advance(stuck)
    assert follower.lost()


def test_picks_and_places_upright_at_the_goal_without_touching_anything(table_scene, pick_loop):
    # The target's centre stands 0.05 m above the table, whose top is at 0.75 m.
    goal_m = (0.62, -0.05, 0.80)
    loop = pick_loop(table_scene, "target", goal_m)
    robot = robot_in(table_scene.privileged("target", goal_m=goal_m))
    assert carry_out(robot, pick(robot, 0), loop.step)[1] is None
    assert loop.held == "target"
    assert np.linalg.norm(loop.ee_point_m() - REST_POSITION_M) < 0.05
    assert loop.peak_impulse_n_s == 0.0
    times_s = robot.timings_s
    assert times_s["plan"] == pytest.approx(times_s["target"] + times_s["motion"])
    robot.steps = 0
    assert place_score(robot, 0, robot.base) > 0
    assert carry_out(robot, place(robot, 0), loop.step)[1] is None
    assert loop.held is None
    assert np.linalg.norm(loop.ee_point_m() - REST_POSITION_M) < 0.05
    pose = loop.step(robot.command()).world_from_body["target"]
    assert np.linalg.norm(pose[:3, 3] - goal_m) < 0.06
    assert pose[2, 2] > 0.99
    assert loop.peak_impulse_n_s == 0.0


def test_arm_that_does_not_move_is_an_execution_failure_after_planning_again(
    table_scene, monkeypatch
):
    state = table_scene.privileged("target")
    robot, stages = robot_in(state), []
    monkeypatch.setattr(robot, "spend", lambda stage, _seconds: stages.append(stage))
    commands, failure = carry_out(robot, pick(robot, 0), lambda _command: state)
    assert failure is Failure.EXECUTION
    assert {command.gripper for command in commands} == {RELEASE}
    # One motion plan at first, and one for each time that it tries again.
    assert stages.count("motion") == 1 + SpaConfig().retries


def test_agent_keeps_the_contract_for_several_rows(table_scene):
    agent = spa_priv(AgentSetup(env_id="hab_tasks:HabPick-v1"))
    assert isinstance(agent, Agent)
    assert agent.spec.privileged
    assert agent.spec.control_mode == "joint_target"
    agent.reset(torch.tensor([True, True]), [7, 7])
    state = table_scene.privileged("target")
    first = agent.act({"privileged": [state, state]})
    assert first.shape == (2, 8)
    assert first.dtype == torch.float32
    torch.testing.assert_close(first[0], first[1])
    agent.reset(torch.tensor([False, True]), [0, 8])
    second = agent.act({"privileged": [state, state]})
    assert not torch.equal(second[0], second[1])
    for report in agent.report():
        assert report.failure is None
        assert set(report.timings_s) == {"target", "motion", "plan"}
