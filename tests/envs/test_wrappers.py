"""The wrappers that ManiSkill's and Gymnasium's users put around an environment."""

import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest
from mani_skill.utils.wrappers.gymnasium import CPUGymWrapper

from hab_tasks.envs import ENVS

every_env = pytest.mark.parametrize("env_id", ENVS)


@every_env
def test_cpu_wrapper_gives_plain_arrays(make, env_id):
    env = CPUGymWrapper(make(env_id, obs_mode="state"), record_metrics=True)
    obs, _ = env.reset(seed=0)
    assert isinstance(obs, np.ndarray)
    assert env.observation_space.contains(obs)
    assert obs.shape == (sum(e.shape[0] for e in ENVS[env_id].env.skill.observation),)
    for _ in range(5):
        obs, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert env.observation_space.contains(obs)
        assert np.isscalar(reward) or reward.shape == ()
        assert isinstance(bool(terminated), bool)
        assert not truncated
    assert info["episode"]["return"] == pytest.approx(np.sum(env.returns))
    terms = info["reward_terms"]
    assert sum(float(t) for t in terms.values()) == pytest.approx(float(reward), abs=1e-5)


@every_env
def test_the_id_with_the_module_needs_no_import(env_id):
    code = f"import gymnasium; print(gymnasium.make('hab_tasks:{env_id}').unwrapped.skill.name)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.split() == [ENVS[env_id].env.skill.name]


def one(env_id, file):
    """Makes a plain environment in a worker process."""
    import hab_tasks  # noqa: F401

    return CPUGymWrapper(gym.make(env_id, obs_mode="state", episodes=file))


@every_env
def test_two_processes_play_what_one_plays(make, env_id, episode_files):
    file = str(episode_files[env_id])
    makers = [lambda: one(env_id, file)] * 2
    single = CPUGymWrapper(make(env_id, obs_mode="state"))
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (10, 2, *single.action_space.shape)).astype(np.float32)
    actions[..., -1] = -1.0  # nothing is grasped, so that no episode ends
    # "spawn", as threads and fork do not mix.
    pair = gym.vector.AsyncVectorEnv(makers, context="spawn")
    try:
        begun, _ = pair.reset(seed=[3, 4])
        both = [begun] + [pair.step(a)[0] for a in actions]
    finally:
        pair.close()
    for row, seed in enumerate((3, 4)):
        alone = [single.reset(seed=seed)[0]] + [single.step(a[row])[0] for a in actions]
        for step, (a, b) in enumerate(zip(both, alone, strict=True)):
            assert np.array_equal(a[row], b), f"row {row}, step {step}"
