"""Saving and restoring the middle of an episode; ManiSkill's recorder and its replay."""

import json

import h5py
import numpy as np
import pytest
import torch
from builders import first_episode, go_above_and_grasp, same, starts_on
from mani_skill.trajectory import utils as trajectory_utils
from mani_skill.utils.wrappers.record import RecordEpisode

from hab_tasks.envs import ENVS

every_env = pytest.mark.parametrize("env_id", ENVS)


def wave(count, seed=0, gripper=-1.0):
    """Small end-effector movements; the gripper entry stays the same."""
    drawn = np.random.default_rng(seed).uniform(-1, 1, (count, 4)).astype(np.float32)
    drawn[:, 3] = gripper
    return drawn


def record(env, actions):
    """What every step gives, poses of all objects included."""
    found = []
    for action in actions:
        obs, reward, *_, info = env.step(action)
        coms = env.unwrapped.privileged()[0].object_com_m
        found.append({"obs": obs, "reward": reward, "measures": info["measures"], "coms": coms})
    return found


def near_table(env):
    """An episode at a table or counter, with something beside the target."""
    return first_episode(env, lambda e: starts_on(e, "Tbl", "counter") and len(e.objects) > 1)


def start_holding(make, env_id, held):
    env = make(env_id, control_mode="ee", obs_mode="state_dict")
    env.reset(options={"episode": near_table(env)})
    if held:
        go_above_and_grasp(env, env.unwrapped.episode[0].target)
        record(env, [np.array([0, 0, 1, 1], dtype=np.float32)] * 3)
        assert env.unwrapped.privileged()[0].held == env.unwrapped.episode[0].target
    else:
        record(env, wave(10))
    return env


@every_env
@pytest.mark.parametrize("held", [False, True], ids=["empty hand", "holding"])
def test_the_continuation_equals_the_original(make, env_id, held):
    env = start_holding(make, env_id, held)
    state = env.unwrapped.get_state_dict()
    actions = wave(20, seed=1, gripper=1.0 if held else -1.0)
    original = record(env, actions)
    env.unwrapped.set_state_dict(state)
    assert same(env.unwrapped.get_state_dict(), state, atol=1e-5)
    again = record(env, actions)
    for step, (a, b) in enumerate(zip(original, again, strict=True)):
        # Forces are left out: contacts are found anew after a restore.
        for entry in ("obs", "coms"):
            assert same(a[entry], b[entry], atol=1e-4), f"{entry} of step {step}"


@every_env
def test_another_environment_goes_on_alike(make, env_id):
    """In another process's place: a new environment, in the same episode, that never grasped."""
    env = start_holding(make, env_id, held=True)
    state = env.unwrapped.get_state_dict()
    actions = wave(20, seed=1, gripper=1.0)
    original = record(env, actions)
    other = make(env_id, control_mode="ee", obs_mode="state_dict")
    other.reset(options={"episode": env.unwrapped.episode[0]})
    other.unwrapped.set_state_dict(state)
    again = record(other, actions)
    for step, (a, b) in enumerate(zip(original, again, strict=True)):
        for entry in ("obs", "coms"):
            assert same(a[entry], b[entry], atol=1e-4), f"{entry} of step {step}"


@every_env
def test_a_restored_held_object_still_spares_the_robot(make, env_id):
    env = start_holding(make, env_id, held=True)
    world = env.unwrapped._world
    index = int(world._grasp.held[0])

    def groups():
        shapes = world._grasp.objects[index]._bodies[0].collision_shapes
        return [tuple(s.get_collision_groups()[:2]) for s in shapes]

    before = groups()
    env.unwrapped.set_state_dict(env.unwrapped.get_state_dict())
    assert groups() == before


@every_env
def test_the_hand_is_empty_again_in_a_state_before_the_grasp(make, env_id):
    env = start_holding(make, env_id, held=False)
    state = env.unwrapped.get_state_dict()
    start = env.unwrapped.privileged()[0].object_com_m
    go_above_and_grasp(env, env.unwrapped.episode[0].target)
    assert env.unwrapped.privileged()[0].held is not None
    env.unwrapped.set_state_dict(state)
    now = env.unwrapped.privileged()[0]
    assert now.held is None
    assert same(now.object_com_m, start, atol=1e-5)
    assert not env.unwrapped.measures.holding_target
    env.step(np.zeros(4, dtype=np.float32) - np.array([0, 0, 0, 1], dtype=np.float32))
    assert not env.unwrapped.evaluate()["fail"]


@every_env
def test_a_falling_object_goes_on_falling(make, env_id):
    env = start_holding(make, env_id, held=False)
    base = env.unwrapped
    (episode,) = base.episode
    name = next(n for n in sorted(episode.objects) if n != episode.target)
    actor = base._world.handles.pickables[name]
    state = base.get_state_dict()
    state["actors"][actor.name][0, :3] = torch.tensor([*episode.robot.base[:2], 2.2])
    state["actors"][actor.name][0, 9] = -1.0
    base.set_state_dict(state)
    height = float(base.privileged()[0].object_com_m[name][2])
    env.step(np.array([0, 0, 0, -1], dtype=np.float32))
    # One action is 1/30 s: at 1 m/s downwards it falls by more than 3 cm.
    assert float(base.privileged()[0].object_com_m[name][2]) < height - 0.03


def recording(env, folder):
    """Records 12 steps with ManiSkill's wrapper; returns what its two files hold."""
    recorder = RecordEpisode(env, str(folder), save_video=False, trajectory_name="t")
    recorder.reset(seed=5)
    measured = [recorder.step(a)[-1]["measures"]["ee_to_object_m"].clone() for a in wave(12)]
    recorder.flush_trajectory()
    recorder._h5_file.close()
    told = json.loads((folder / "t.json").read_text())
    (episode,) = told["episodes"]
    with h5py.File(folder / "t.h5") as file:
        data = file[f"traj_{episode['episode_id']}"]
        actions = np.asarray(data["actions"])
        states = trajectory_utils.dict_to_list_of_dicts(data["env_states"])
    return (
        {
            "env_id": told["env_info"]["env_id"],
            "reset_kwargs": {"seed": 5, **episode["reset_kwargs"]},
        },
        {"actions": actions, "states": states, "measured": measured},
    )


@every_env
def test_a_recording_replays(make, env_id, tmp_path):
    told, data = recording(make(env_id, control_mode="ee", obs_mode="state_dict"), tmp_path)
    assert told["env_id"] == env_id
    assert np.array_equal(data["actions"], wave(12))
    assert len(data["states"]) == 13
    player = make(env_id, control_mode="ee", obs_mode="state_dict")
    player.reset(**told["reset_kwargs"])
    for action, expected in zip(data["actions"], data["measured"], strict=True):
        now = player.step(action)[-1]["measures"]["ee_to_object_m"]
        assert torch.equal(now, expected)


@every_env
def test_a_recorded_state_restores(make, env_id, tmp_path):
    """As ManiSkill's replay with ``--use-env-states`` does it."""
    env = make(env_id, control_mode="ee", obs_mode="state_dict")
    told, data = recording(env, tmp_path)
    player = make(env_id, control_mode="ee", obs_mode="state_dict")
    player.reset(**told["reset_kwargs"])
    player.unwrapped.set_state_dict(data["states"][6])
    for action, expected in zip(wave(12)[6:], data["measured"][6:], strict=True):
        now = player.step(action)[-1]["measures"]["ee_to_object_m"]
        assert torch.allclose(now, expected, atol=1e-4)
