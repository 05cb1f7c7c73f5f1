"""Control modes that set joints directly: held objects follow, and furniture stops the robot."""

import numpy as np
import pytest
from playing import held, put, still


def in_hand(env):
    """The held object's pose (7,) in the hand."""
    base = env.unwrapped
    grasp = base.simulation.grasp
    pose = base.agent.ee_link.pose.inv() * grasp.objects[grasp.held].pose
    return pose.raw_pose[0].numpy()


@pytest.fixture(params=["joint_state_pose", "joint_target_pose"])
def carrying(make, request):
    """TidyHouse with the first target in the hand."""
    env = make("HabTidyHouse-v1", control_mode=request.param)
    env.reset(seed=0)
    name = env.unwrapped.episode[0].targets[0].object
    put(env, name, (0.0, 0.0, -0.14))
    action = still(env)
    action[7] = 1.0
    env.step(action)
    assert held(env) == name
    return env


def base_of(env):
    return np.asarray(env.unwrapped.simulation.snapshot.base)[0].copy()


def test_what_is_held_comes_along(carrying):
    before, start = in_hand(carrying), base_of(carrying)
    for _ in range(10):
        action = still(carrying)
        action[7] = 1.0
        action[-1] += 0.1
        carrying.step(action)
        assert held(carrying) is not None
        assert np.linalg.norm(in_hand(carrying)[:3] - before[:3]) < 1e-3
    assert np.allclose(base_of(carrying) - start, (0.0, 0.0, 1.0), atol=1e-2)


def test_furniture_stops_the_robot_and_counts(make):
    """Nor is it passed by, however far away the pose is."""
    env = make("HabTidyHouse-v1", control_mode="joint_state_pose")
    env.reset(seed=0)
    base, start = env.unwrapped, base_of(env)
    found, forces = [], []
    for _ in range(200):
        action = still(env)
        action[-3] += 1.0  # 20 m ahead are walls
        env.step(action)
        found.append(base_of(env))
        forces.append(float(base.measures.force_n[0]))
    steps_m = np.linalg.norm(np.diff(np.array([start, *found])[:, :2], axis=0), axis=1)
    assert max(steps_m) < 1 / 30 + 1e-3
    assert np.allclose(found[-20:], found[-1], atol=0.02), "it still gets on"
    assert min(forces[-20:]) > 0.0
    action = still(env)
    action[-3] -= 1.0
    env.step(action)
    assert base_of(env)[0] < found[-1][0] - 0.02, "it does not come out"


def test_a_delayed_base_pose_waits_where_the_robot_stands(make):
    env = make("HabTidyHouse-v1", control_mode="joint_state_pose", action_delay_steps=2)
    env.reset(seed=0)
    start, found = base_of(env), []
    action = still(env)
    action[-1] += 0.1
    for _ in range(4):
        env.step(action)
        found.append(base_of(env))
    assert np.allclose(found[1], start, atol=1e-4)
    assert np.allclose(found[2] - start, (0.0, 0.0, 0.1), atol=1e-3)
