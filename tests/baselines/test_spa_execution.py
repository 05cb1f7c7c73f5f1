"""Timing, path following, skills in closed loop, and the agent."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from hab_spa import Failure, spa_priv
from hab_spa.motion.follow import FollowConfig, Follower
from hab_spa.motion.robot import RELEASE, Robot, SpaConfig
from hab_spa.planning.path import TimingConfig, time_path
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.skills.pick import pick, pick_score
from hab_spa.skills.place import place, place_score

from hab_tasks.agent import Agent, AgentSetup
from hab_tasks.constants import REST_POSITION_M
from hab_tasks.errors import UnknownNameError
from hab_tasks.robots.robot import ROBOT

REST = np.array(ROBOT.rest_qpos_rad)
CORNER = np.array([np.zeros(7), np.eye(7)[0], np.eye(7)[0] + np.eye(7)[1] * 0.5])
STEPS = 200


def robot_in(state, seed=0, config=None):
    """Returns a robot that has seen a state."""
    scene = TrueScene()
    scene.see({"privileged": [state]}, 0)
    return Robot(scene, config or SpaConfig(), seed=seed, deadline=STEPS)


def carry_out(robot, motion, step, steps=STEPS):
    """Does a skill; `step` takes a command and returns the state after it.

    Returns the commands and what the skill returned; fails when it takes too long.
    """
    commands = []
    for _ in range(steps):
        try:
            commands.append(next(motion))
        except StopIteration as end:
            return commands, end.value
        robot.steps += 1
        robot.scene.see({"privileged": [step(commands[-1])]}, 0)
    return pytest.fail(f"not over after {steps} steps")


def test_targets_stay_on_the_path_and_end_at_its_end():
    targets = time_path(CORNER, TimingConfig())
    np.testing.assert_allclose(targets[-1], CORNER[-1])
    on_first = np.isclose(targets[:, 1], 0.0)
    on_second = np.isclose(targets[:, 0], 1.0)
    assert np.all(on_first | on_second)
    # A path without length has one target.
    np.testing.assert_array_equal(time_path(np.stack((REST, REST)), TimingConfig()), REST[None])


def test_targets_respect_step_and_acceleration():
    config = TimingConfig()
    targets = np.concatenate((CORNER[:1], time_path(CORNER, config)))
    steps = np.abs(np.diff(targets, axis=0)).max(axis=1)
    assert steps.max() <= config.step_rad + 1e-9
    assert steps.max() > 0.9 * config.step_rad
    # Slow at both ends and at the corner, where the whole speed changes its direction.
    corner = int(np.argmax(targets[:, 1] > 0))
    for slow in (steps[0], steps[-1], steps[corner]):
        assert slow < 0.7 * config.step_rad


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


def test_follower_settles_at_the_end():
    targets = np.linspace(0.0, 0.2, 5)[1:, None] * np.ones(7)
    follower = Follower(targets, FollowConfig())
    for _ in range(4):
        qpos = follower.advance(follower.target)
        assert not follower.settled(qpos - 0.1)
    assert follower.settled(targets[-1])


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


def test_place_with_an_empty_hand_only_rests(table_scene, pick_loop):
    table_scene.set_arm(REST + 0.2 * np.eye(7)[0])
    loop = pick_loop(table_scene, "target")
    robot = robot_in(table_scene.privileged("target"))
    commands, failure = carry_out(robot, place(robot, 0), loop.step)
    assert failure is Failure.EXECUTION
    np.testing.assert_allclose(commands[-1].arm_rad, REST, atol=0.05)


def test_ways_depend_on_where_the_base_is_thought_to_be(table_scene):
    robot = robot_in(table_scene.privileged("target"))
    near, far = np.zeros(3), np.array((-1.5, 0.0, 0.0))
    assert pick_score(robot, 0, near) > 10
    assert pick_score(robot, 0, far) == 0
    # Nothing is changed by thinking of another place.
    assert pick_score(robot, 0, near) == pick_score(robot, 0, near)


def test_same_seed_same_commands(table_scene):
    state = table_scene.privileged("target")
    targets_rad = []
    for seed in (3, 3, 4):
        motion = pick(robot_in(state, seed), 0)
        targets_rad.append(np.stack([next(motion).arm_rad for _ in range(5)]))
    np.testing.assert_array_equal(targets_rad[0], targets_rad[1])
    assert not np.array_equal(targets_rad[0], targets_rad[2])


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


def test_grasp_that_does_not_hold_is_an_execution_failure(table_scene):
    def step(command):
        table_scene.set_arm(command.arm_rad)
        return table_scene.privileged("target")

    robot = robot_in(table_scene.privileged("target"), config=SpaConfig(retries=0))
    _, failure = carry_out(robot, pick(robot, 0), step)
    assert failure is Failure.EXECUTION


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


def test_agent_refuses_a_skill_it_does_not_have():
    with pytest.raises(UnknownNameError, match="HabPick-v1"):
        spa_priv(AgentSetup(env_id="HabTidyHouse-v1"))


@pytest.mark.slow
def test_a_run_ends_without_complaints(tmp_path):
    program = Path(sys.executable).parent / "hab-eval"
    options = ("--agent", "hab_spa:spa_priv", "--env", "HabPick-v1", "--episodes", "1")
    done = subprocess.run(
        [program, "run", *options, "--out", tmp_path / "run"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert "leaked" not in done.stdout + done.stderr
