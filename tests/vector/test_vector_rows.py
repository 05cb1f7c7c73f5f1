"""Rows of a vector environment equal single environments, in all that is returned."""

import itertools

import gymnasium as gym
import pytest
from gymnasium.vector import AutoresetMode
from playing import long, slow
from vectors import EPISODES, MAX_STEPS, assert_equals_single, info_keys, make_vec, roll_out

from hab_tasks.envs import ENVS

STEPS = 60
SEED = 5
IN_CI = ("HabPlace-v1", "HabCloseFridge-v1", "HabSetTable-v1")
"""With each mode of autoreset one environment; the quick tests have Pick and Navigate."""

OPTIONS = {
    "depth with noise and delay": {
        "obs_mode": "depth",
        "sensor_noise": {},
        "action_delay_steps": 2,
    },
    "state and images": {"obs_mode": "rgb+depth+state", "reward_mode": "normalized_dense"},
    "end-effector frame": {"target_frame": "ee", "proprioception": False, "reward_mode": "none"},
}
"""Options that take another path through the code."""

OPTIONS_IN_CI = ("depth with noise and delay", "end-effector frame")


def check(env_id, mode, rows=3, steps=STEPS, repeat=1, **options):
    """Compares every row with an environment of its own."""
    shown = {"info_keys": info_keys(env_id, **options), "autoreset_mode": mode}
    env = make_vec(env_id, rows, num_workers=2, action_repeat=repeat, **shown, **options)
    try:
        rolled = roll_out(env, steps, SEED)
        ends = sum(int((e[2] | e[3]).sum()) for e in rolled.steps if len(e) == 5)
        assert ends >= rows  # each row was reset at least once
        for row in range(rows):
            single = gym.make(
                f"hab_tasks:{env_id}",
                max_episode_steps=MAX_STEPS,
                num_episodes=EPISODES,
                **options,
            )
            assert_equals_single(env, rolled, row, single, SEED + row, repeat)
            single.close()
    finally:
        env.close()


def test_rows_equal_single_environments():
    check("HabPick-v1", AutoresetMode.NEXT_STEP, rows=2, steps=30)


def test_repeated_actions_equal_those_of_single_environments():
    """Episodes of 25 steps end within the seventh action of four steps."""
    check("HabNavigate-v1", AutoresetMode.NEXT_STEP, rows=2, steps=9, repeat=4)


@pytest.mark.render
@slow
def test_repeated_actions_with_images_equal_those_of_single_environments():
    check("HabPlace-v1", AutoresetMode.SAME_STEP, rows=2, steps=12, repeat=4, obs_mode="depth")


@pytest.mark.parametrize(
    ("env_id", "mode"),
    [
        pytest.param(env_id, mode, marks=slow if env_id in IN_CI else long)
        for env_id, mode in zip(ENVS, itertools.cycle(AutoresetMode), strict=False)
        if env_id not in ("HabPick-v1", "HabNavigate-v1")
    ],
)
def test_rows_of_every_env_equal_single_environments(env_id, mode):
    """Each mode of autoreset with several environments."""
    check(env_id, mode, steps=MAX_STEPS + 5)


@pytest.mark.render
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=slow if n in OPTIONS_IN_CI else long) for n in OPTIONS]
)
def test_rows_with_options_equal_single_environments(name):
    check("HabPick-v1", AutoresetMode.SAME_STEP, rows=2, steps=MAX_STEPS + 5, **OPTIONS[name])


@slow
@pytest.mark.parametrize(
    ("env_id", "control_mode"),
    [("HabNavigate-v1", "base_discrete"), ("HabTidyHouse-v1", "joint_target_pose")],
)
def test_rows_with_other_actions_equal_single_environments(env_id, control_mode):
    check(env_id, AutoresetMode.NEXT_STEP, rows=2, steps=MAX_STEPS + 5, control_mode=control_mode)


@slow
@pytest.mark.assets
def test_rows_in_replica_cad_equal_single_environments(replica_cad, ycb):
    check(
        "HabSetTable-v1",
        AutoresetMode.SAME_STEP,
        rows=2,
        steps=MAX_STEPS + 5,
        scene_dataset=str(replica_cad),
        objects=str(ycb),
        obs_mode="state_dict",
    )


@slow
def test_workers_share_the_episodes_they_generate():
    env = make_vec("HabPick-v1", 2, num_workers=2, num_episodes=1, episode_seed=91)
    try:
        env.reset(seed=[3, 3])
        folder = env._team._folder
        assert [file.suffix for file in folder.iterdir()] == [".json"]
    finally:
        env.close()
    assert not folder.exists()
