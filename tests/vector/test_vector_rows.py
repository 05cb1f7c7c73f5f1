"""Rows of a vector environment equal single environments, in all that is returned."""

import itertools
from contextlib import closing

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

OPTIONS = (
    (slow, {"obs_mode": "depth", "sensor_noise": {}, "action_delay_steps": 2}),
    (long, {"obs_mode": "rgb+depth+state", "reward_mode": "normalized_dense"}),
    (slow, {"target_frame": "ee", "proprioception": False, "reward_mode": "none"}),
)
"""Options that take another path through the code."""


def check(env_id, mode, rows=3, steps=STEPS, repeat=1, **options):
    """Compares every row with an environment of its own."""
    shown = {"info_keys": info_keys(env_id, **options), "autoreset_mode": mode}
    made = make_vec(env_id, rows, num_workers=2, action_repeat=repeat, **shown, **options)
    with closing(made) as env:
        rolled = roll_out(env, steps, SEED)
        ends = sum(int((e[2] | e[3]).sum()) for e in rolled.steps if len(e) == 5)
        assert ends >= rows  # each row was reset at least once
        short = {"max_episode_steps": MAX_STEPS, "num_episodes": EPISODES}
        for row in range(rows):
            single = gym.make(f"hab_tasks:{env_id}", **short, **options)
            assert_equals_single(env, rolled, row, single, SEED + row, repeat)
            single.close()


def test_rows_equal_single_environments():
    check("HabPick-v1", AutoresetMode.NEXT_STEP, rows=2, steps=30)


def test_repeated_actions_equal_those_of_single_environments():
    """Episodes of 25 steps end within the seventh action of four steps."""
    check("HabNavigate-v1", AutoresetMode.NEXT_STEP, rows=2, steps=9, repeat=4)


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
@pytest.mark.parametrize("options", [pytest.param(o, marks=mark) for mark, o in OPTIONS])
def test_rows_with_options_equal_single_environments(options):
    check("HabPick-v1", AutoresetMode.SAME_STEP, rows=2, steps=MAX_STEPS + 5, **options)


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
    real = {"scene_dataset": str(replica_cad), "objects": str(ycb), "obs_mode": "state_dict"}
    check("HabSetTable-v1", AutoresetMode.SAME_STEP, rows=2, steps=MAX_STEPS + 5, **real)
