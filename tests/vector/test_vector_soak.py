"""Memory and values of a vector environment over many steps; see also `make soak`."""

import os
from contextlib import closing

import gymnasium as gym
import psutil
import pytest
from playing import long
from soak import check_finite
from vectors import sampled_actions

ENVS = ("HabPick-v1", "HabSetTable-v1")
STEPS = int(os.environ.get("HAB_VECTOR_SOAK_STEPS", "4000")) // len(ENVS)
CHUNK_STEPS = 50
ROWS = 4
MOST_GROWTH = 0.05


@long
@pytest.mark.timeout(24 * 3600)
@pytest.mark.parametrize("env_id", ENVS)
def test_rows_take_no_further_memory(env_id):
    env = gym.make_vec(
        f"hab_tasks:{env_id}",
        num_envs=ROWS,
        num_workers=2,
        num_episodes=10,
        max_episode_steps=100,
        obs_mode="state_dict",
        info_keys=["success", "measures"],
    )
    half_bytes = 0
    with closing(env):
        env.reset(seed=0)
        for start in range(0, STEPS, CHUNK_STEPS):
            for actions in sampled_actions(env.single_action_space, ROWS, CHUNK_STEPS, seed=start):
                obs, reward, _, _, info = env.step(actions)
                check_finite("step", (obs, reward, info))
            if not half_bytes and 2 * start >= STEPS:
                half_bytes = _memory_bytes(env)
        assert _memory_bytes(env) / half_bytes <= 1.0 + MOST_GROWTH


def _memory_bytes(env):
    """Resident memory of all processes of a vector environment, without mapped files.

    Proportional memory would grow whenever another process that maps the same libraries ends.
    """
    infos = [psutil.Process(pid).memory_info() for pid in (os.getpid(), *env.worker_pids)]
    return sum(info.rss - info.shared for info in infos)
