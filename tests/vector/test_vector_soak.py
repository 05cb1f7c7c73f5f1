"""Memory and values of vector environments over many steps; see also `make soak`."""

import logging
import os
from contextlib import closing

import gymnasium as gym
import numpy as np
import psutil
import pytest
from playing import slow
from soak import check_finite
from vectors import sampled_actions

from hab_tasks.envs import ENVS

STEPS = int(os.environ.get("HAB_VECTOR_SOAK_STEPS", "500"))
"""Steps of all rows, in all environments together."""

LONG_STEPS = 50_000
"""Growth of memory is looked at in runs of so many steps."""

ROWS = 16 if STEPS >= LONG_STEPS else 4
EPISODES = 10
CHUNK_STEPS = 50
MOST_GROWTH = 0.05
logger = logging.getLogger(__name__)

pytestmark = pytest.mark.timeout(24 * 3600)


@slow
@pytest.mark.parametrize("env_id", ENVS)
def test_rows_take_no_further_memory(env_id):
    steps = STEPS // len(ENVS)
    env = gym.make_vec(
        f"hab_tasks:{env_id}",
        num_envs=ROWS,
        num_workers=2,
        num_episodes=EPISODES,
        obs_mode="state_dict",
        info_keys=["success", "measures"],
    )
    ended, half_bytes = 0, 0
    with closing(env):
        env.reset(seed=0)
        for start in range(0, steps, CHUNK_STEPS):
            count = min(CHUNK_STEPS, steps - start)
            for actions in sampled_actions(env.single_action_space, ROWS, count, seed=start):
                obs, reward, terminated, truncated, info = env.step(actions)
                check_finite("step", (obs, reward, info))
                ended += int(np.sum(terminated | truncated))
            if 2 * (start + count) <= steps or not half_bytes:
                half_bytes = _memory_bytes(env)
        growth = _memory_bytes(env) / half_bytes - 1.0
    logger.info("%s: %d steps, %d ends, growth %.1f %%", env_id, steps, ended, 100.0 * growth)
    if STEPS >= LONG_STEPS:
        assert ended >= ROWS
        assert growth <= MOST_GROWTH


def _memory_bytes(env):
    """Resident memory of all processes of a vector environment, without mapped files.

    Proportional memory would grow whenever another process that maps the same libraries ends.
    """
    infos = [psutil.Process(pid).memory_info() for pid in (os.getpid(), *env.worker_pids)]
    return sum(info.rss - info.shared for info in infos)
