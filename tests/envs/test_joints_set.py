"""Control modes that set joints directly: touched objects wake up."""

import numpy as np
from playing import move_object, still


def test_what_the_robot_is_put_into_gives_way(make):
    """Also what was frozen, far from anything that could have touched it."""
    env = make("HabTidyHouse-v1", control_mode="joint_state_pose")
    env.reset(seed=0)
    base = env.unwrapped
    world = base._simulation
    name = base.episode[0].targets[1].object
    x, y, yaw = np.asarray(world.snapshot.base)[0]
    ahead, left, up = np.asarray(world.snapshot.ee_m)[0] - (x, y, 0.0)
    goal = world.goals.base[0].copy()
    c, s = np.cos(goal[2] - yaw), np.sin(goal[2] - yaw)
    # Between the fingers to come.
    there_m = (goal[0] + c * ahead - s * left, goal[1] + s * ahead + c * left, up + 0.05)
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
    assert np.linalg.norm(base.privileged()[0].object_com_m[name] - there_m) > 0.05
    # 0.7 s of falling make 7 m/s at most; an explosion would be tens of metres a second
    assert max(speeds) < 8.0
