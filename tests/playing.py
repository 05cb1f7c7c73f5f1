"""Rollouts of any environment and control mode, with sampled actions and moved objects."""

import numpy as np
import pytest
import torch
from builders import ee_action
from gymnasium import spaces

from hab_tasks.envs import ENVS
from hab_tasks.robots.control_modes import ABSOLUTE_ARM, STOP_CELL

FAMILIES = ("HabPick-v1", "HabOpenFridge-v1", "HabNavigate-v1", "HabSetTable-v1")
"""One of each kind: takes objects, takes handles, drives only, does everything."""

KINDS = (*FAMILIES, "HabPlace-v1")
"""These, and what starts with an object in the hand."""

slow, long = pytest.mark.slow, pytest.mark.long
each_family = pytest.mark.parametrize("env_id", FAMILIES)


def ee_mode(env_id):
    """The mode that moves the end-effector, or the only ones there are."""
    modes = ENVS[env_id].env.control_modes
    return next((mode for mode in modes if mode.startswith("ee")), modes[0])


def actions(env, count, seed=0, gripper=None):
    """Random actions; joint and base poses stay near the present ones, as a planner's do.

    Args:
        gripper: Every action's gripper entry, where there is one; None draws it.
    """
    rng, space = np.random.default_rng(seed), env.unwrapped.single_action_space
    if isinstance(space, spaces.Discrete):
        # Not to stop, which may end the episode.
        return [int(cell) for cell in rng.permuted(_cells(count, space.n))]
    base = env.unwrapped
    drawn = rng.uniform(-1, 1, (count, *space.shape)).astype(np.float32)
    config = base.agent.controller.config
    if config.arm in ABSOLUTE_ARM:
        drawn[:, :7] = arm(base) + 0.1 * drawn[:, :7]
    if config.base == "pose":
        drawn[:, -3:] = base.agent.controller.base_target + 0.02 * drawn[:, -3:]
    size = config.arm_size
    if gripper is not None and size:
        drawn[:, size] = gripper
    return list(np.clip(drawn, space.low, space.high))


def _cells(count, cells):
    return np.resize([cell for cell in range(cells) if cell != STOP_CELL], count)


def still(env):
    """The action that moves nothing and keeps what is held."""
    base = env.unwrapped
    return base.agent.controller.idle_action(base.simulation.grasp.holding)


def arm(base):
    return base.agent.controller.arm_target_rad.copy()


def play(env, sequence):
    """Steps until the episode ends; returns every (obs, reward, terminated, truncated, info)."""
    steps = []
    for action in sequence:
        steps.append(env.step(action))
        if steps[-1][2] or steps[-1][3]:
            break
    return steps


def record(env, sequence):
    """What every step gives, poses of all objects and joints of all furniture included."""
    found = []
    for action in sequence:
        obs, reward, *_, info = env.step(action)
        found.append(
            {
                "obs": obs,
                "reward": reward,
                "measures": info["measures"],
                "coms": env.unwrapped.privileged()[0].object_com_m,
                "joints": joints(env),
            }
        )
    return found


def joints(env):
    """Furniture name -> its joints' positions."""
    furniture = env.unwrapped.simulation.scene_bodies.articulations
    return {name: piece.get_qpos()[0].numpy().copy() for name, piece in furniture.items()}


def flat(value, name=""):
    """Every tensor or array of a nested dict with its path."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from flat(item, f"{name}/{key}")
    else:
        yield name, value


# States that tests put the simulator into ------------------------------------------------------


def held(env):
    """Name of the held object, None for nothing."""
    return env.unwrapped.privileged()[0].held


def move_object(state, env, name, com_m):
    """Writes into a state that an object's centre of mass is at `com_m` (3,), at rest."""
    world = env.unwrapped.simulation
    index = world._names.index(name)
    actor = world.grasp.objects[index]
    com = world.grasp.objects_com_m()[index] - actor.pose.p[0].numpy()
    state["actors"][actor.name][0, :3] = torch.as_tensor(np.subtract(com_m, com))
    state["actors"][actor.name][0, 7:] = 0.0


def put(env, name, offset_m):
    """Puts an object's centre of mass at the end-effector plus `offset_m`."""
    base = env.unwrapped
    state = base.get_state_dict()
    move_object(state, env, name, np.asarray(base.simulation.snapshot.ee_m)[0] + offset_m)
    base.set_state_dict(state)


def move_joint(state, env, number, position):
    """Writes into a state where the numbered door or drawer of the goals stands [m or rad]."""
    world = env.unwrapped.simulation
    handle = world.grasp.handles[world.handles[number]]
    entry = state["articulations"][handle.furniture.name]
    count = len(handle.furniture.active_joints)
    entry[0, 13 + handle.column] = position
    entry[0, 13 + count + handle.column] = 0.0


def move_base(state, env, x_m, y_m, yaw_rad):
    """Writes into a state where the robot stands."""
    agent = env.unwrapped.agent
    entry = state["articulations"][agent.robot.name]
    for joint, value in zip(agent.base_index.tolist(), (x_m, y_m, yaw_rad), strict=True):
        entry[0, 13 + joint] = float(value)


def ee_grip(env, gripper=1.0):
    """The action of ``ee`` or ``ee_base`` that moves nothing."""
    return ee_action(env, np.zeros(3), gripper)
