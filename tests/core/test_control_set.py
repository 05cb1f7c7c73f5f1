"""Control modes that set joints and base poses directly."""

import math

import numpy as np
from fetch_sim import GRASP, RELEASE, FetchSim

from hab_tasks.robots.fetch import FETCH
from hab_tasks.robots.grasp import NOTHING

SETTING = ("joint_state", "joint_state_base", "joint_target_pose", "joint_state_pose")
BOX = ((0.03, 0.04, 0.05), (0.03, 0.02, -0.1))


def test_the_arm_gets_where_it_is_set_by_at_most_0_08_rad_an_action():
    for mode in ("joint_state", "joint_state_pose", "joint_target"):
        sim, rng = FetchSim(mode), np.random.default_rng(0)
        rest = sim.arm().copy()
        for _ in range(5):
            # Around a pose that is clear of the body.
            drawn = rest + rng.uniform(-0.4, 0.4, 7)
            goal = np.clip(drawn, FETCH.arm_lower_rad, FETCH.arm_upper_rad)
            for _ in range(10):  # 0.8 rad / 0.08
                action, before = sim.idle(), sim.idle()
                action[:7] = goal
                sim.act(action)
                assert np.abs(sim.idle()[:7] - before[:7]).max() < 0.08 + 1e-4
            assert np.abs(sim.idle()[:7] - goal).max() < 1e-3
            assert mode == "joint_target" or np.abs(sim.arm() - goal).max() < 1e-3
        assert mode == "joint_target" or max(sim.speeds) < 1e-3, "it came to rest there"


def test_the_base_gets_to_a_pose_at_its_own_speed_and_stays():
    for mode in SETTING[2:]:
        sim = FetchSim(mode)
        arm = sim.arm().copy()
        # 4 rad is 4 - 2 pi = -2.2832. 0.3 m take 9 actions of 1/30 m; 2.2832 rad 21.8 of 3.14 / 30.
        for pose, found, steps in (
            ((0.3, 0.0, 0.0), (0.3, 0.0, 0.0), 9),
            ((0.3, 0.0, 4.0), (0.3, 0.0, -2.2832), 22),
        ):
            action, there = sim.idle(), []
            action[-3:] = pose
            for _ in range(steps + 3):
                sim.act(action)
                there.append(np.allclose(sim.base(), found, atol=1e-3))
            assert there == [False] * (steps - 1) + [True] * 4
            assert np.allclose(sim.idle()[-3:], found, atol=1e-3)
        assert np.allclose(sim.arm(), arm, atol=1e-3)
    space = sim.controller.single_action_space
    assert np.allclose(space.high[-3:], (20.0, 20.0, math.pi))


def test_a_saved_pose_is_restored():
    sim = FetchSim("joint_state_pose")
    action = sim.idle()
    action[-3:] += 0.02, 0.01, 0.05
    sim.act(action)
    qpos, state = sim.agent.robot.get_qpos().clone(), sim.controller.get_state()
    other = FetchSim("joint_state_pose")
    other.agent.robot.set_qpos(qpos)
    other.controller.set_state(state)
    assert np.allclose(other.idle(), sim.idle())
    for _ in range(20):  # nothing draws it back to where it was
        other.scene.px.step()
    assert np.allclose(other.base(), (0.02, 0.01, 0.05), atol=1e-4)


def test_a_held_object_keeps_its_pose_in_the_hand_while_joints_are_set():
    for mode in SETTING:
        sim = FetchSim(mode, [BOX], floating=False)
        sim.act(sim.idle(), GRASP)
        start, action = sim.in_hand(), sim.idle()
        if mode.endswith("_pose"):
            action[-3:] = 2.0, 0.0, 1.0
        for _ in range(5):
            sim.act(action, GRASP)
            assert np.linalg.norm(sim.in_hand()[:3] - start[:3]) < 1e-3
            # 9.81 / 120 is 0.08
            assert np.linalg.norm(sim.objects[0]._bodies[0].linear_velocity) < 0.1
        for step in range(30):
            action = sim.idle()
            action[:7] += 0.03 * np.cos(step / 5) * np.array([1, 0.2, -1, -1, 1, -1, 1])
            if mode.endswith("_pose"):
                action[-3:] += (0.02, -0.02, 0.05)
            elif mode.endswith("_base"):
                action[-2:] = 0.3, 0.3
            sim.act(action, GRASP)
            assert sim.grasp.held == 0
            now = sim.in_hand()
            # Driven joints swing, and a tie gives way to that by some millimetres.
            assert np.linalg.norm(now[:3] - start[:3]) < (5e-3 if "target" in mode else 1e-3), mode
            # |q . q'| = cos(angle / 2); 0.0002 is 2.3 degrees
            assert abs(now[3:] @ start[3:]) > 1 - 2e-4
        sim.act(sim.idle(), RELEASE)
        assert sim.grasp.held == NOTHING


def test_an_arm_that_is_set_into_a_wall_is_not_thrown_out():
    for depth_rad in (0.05, 0.3):
        sim = FetchSim("joint_state_pose", statics=[((0.2, 0.2, 0.2), (0.0, 0.3, 0.0))])
        space = sim.controller.single_action_space
        for _ in range(10):
            action = sim.idle()
            action[0] += depth_rad
            sim.act(np.clip(action, space.low, space.high))
            assert np.allclose(sim.base(), 0.0, atol=2e-3)
        # A light hand turns at some rad/s while it is pushed apart at 1 m/s.
        assert max(sim.speeds) < 10.0
