"""Timing, path following, a skill in closed loop, and the agent."""

import numpy as np
import pytest
from hab_plans.motion import RELEASE
from hab_spa import Failure
from hab_spa.motion.follow import FollowConfig, Follower, TimingConfig, time_path
from hab_spa.motion.robot import Robot, SpaConfig
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.skills.pick import pick

from hab_tasks.robots.fetch import FETCH

REST = np.array(FETCH.rest_qpos_rad)
CORNER = np.array([np.zeros(7), np.eye(7)[0], np.eye(7)[0] + np.eye(7)[1] * 0.5])
STEPS = 200


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


def test_arm_that_does_not_move_is_an_execution_failure_after_planning_again(
    table_scene, monkeypatch
):
    state = table_scene.privileged("target")
    scene, stages = TrueScene(FETCH), []
    scene.see({"privileged": [state]}, 0)
    robot = Robot(scene, SpaConfig(), seed=0, deadline=STEPS)
    monkeypatch.setattr(robot, "spend", lambda stage, _seconds: stages.append(stage))
    motion, failure = pick(robot, 0), None
    for _ in range(STEPS):
        try:
            assert next(motion).gripper == RELEASE
        except StopIteration as end:
            failure = end.value
            break
        robot.steps += 1
        scene.see({"privileged": [state]}, 0)
    assert failure is Failure.EXECUTION
    # One motion plan at first, and one for each time that it tries again.
    assert stages.count("motion") == 1 + SpaConfig().retries
