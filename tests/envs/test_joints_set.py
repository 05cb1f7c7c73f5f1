"""Control modes that set joints directly: held objects follow, and touched objects wake up."""

import numpy as np
import pytest
from playing import held, move_object, put, still


def in_hand(env):
    """The held object's pose (7,) in the hand."""
    base = env.unwrapped
    grasp = base._simulation._grasp
    pose = base.agent.ee_link.pose.inv() * grasp.objects[int(grasp.held[0])].pose
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


def test_a_teleport_takes_along_what_is_held(carrying):
    base, before = carrying.unwrapped, in_hand(carrying)
    start = np.asarray(base._simulation.snapshot.base)[0].copy()
    goal = base._simulation.goals.base[0].copy()  # where the task would have the robot drive
    assert np.linalg.norm(goal[:2] - start[:2]) > 0.2
    action = still(carrying)
    action[-3:] = goal
    for _ in range(5):
        carrying.step(action)
        assert held(carrying) is not None
        assert np.linalg.norm(in_hand(carrying)[:3] - before[:3]) < 1e-3
    assert np.allclose(np.asarray(base._simulation.snapshot.base)[0], goal, atol=1e-3)


def test_what_the_robot_is_put_into_gives_way(make):
    """Also what was frozen, far from anything that could have touched it."""
    env = make("HabTidyHouse-v1", control_mode="joint_state_pose")
    env.reset(seed=0)
    base = env.unwrapped
    world = base._simulation
    name = base.episode[0].targets[1].object
    hand_m = np.asarray(world.snapshot.ee_m)[0]
    goal = world.goals.base[0].copy()
    turn = goal[2] - np.asarray(world.snapshot.base)[0, 2]
    way = hand_m[:2] - np.asarray(world.snapshot.base)[0, :2]
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ way
    there_m = np.append(goal[:2] + turned, hand_m[2] + 0.05)  # between the fingers to come
    state = base.get_state_dict()
    move_object(state, env, name, there_m)
    base.set_state_dict(state)
    body = world._grasp.objects[world._names.index(name)]._bodies[0]
    env.step(still(env))
    assert body.kinematic
    action = still(env)
    action[-3:] = goal
    env.step(action)
    assert not body.kinematic
    speeds = []
    for _ in range(20):
        env.step(action)
        speeds.append(np.linalg.norm(body.linear_velocity))
    moved_m = base.privileged()[0].object_com_m[name] - there_m
    assert np.linalg.norm(moved_m) > 0.05
    # 0.7 s of falling make 7 m/s at most; an explosion would be tens of metres a second
    assert max(speeds) < 8.0


def test_a_delayed_base_pose_waits_where_the_robot_stands(make):
    env = make("HabTidyHouse-v1", control_mode="joint_state_pose", action_delay_steps=2)
    env.reset(seed=0)
    base = env.unwrapped
    start = np.asarray(base._simulation.snapshot.base)[0].copy()
    action = still(env)
    action[-3] += 0.5
    found = []
    for _ in range(4):
        env.step(action)
        found.append(np.asarray(base._simulation.snapshot.base)[0].copy())
    assert np.allclose(found[1], start, atol=1e-4)
    assert np.allclose(found[2] - start, (0.5, 0.0, 0.0), atol=1e-3)
