"""Common wrappers of ManiSkill and Gymnasium."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from mani_skill.utils.wrappers.gymnasium import CPUGymWrapper
from playing import actions, each_family, slow, still

from hab_tasks.envs import ENVS


def whole_size(env_id):
    return sum(entry.shape[0] for entry in ENVS[env_id].env.observation)


@pytest.mark.parametrize("env_id", ["HabPick-v1", "HabSetTable-v1"])
def test_cpu_wrapper_gives_plain_arrays(make, env_id):
    env = CPUGymWrapper(make(env_id, obs_mode="state"), record_metrics=True)
    obs, _ = env.reset(seed=0)
    assert isinstance(obs, np.ndarray)
    assert env.observation_space.contains(obs)
    assert obs.shape == (whole_size(env_id),)
    for action in actions(env, 5, gripper=-1.0):
        obs, reward, terminated, truncated, info = env.step(action)
        assert env.observation_space.contains(obs)
        assert np.isscalar(reward) or reward.shape == ()
        assert isinstance(bool(terminated), bool)
        assert not truncated
    assert info["episode"]["return"] == pytest.approx(np.sum(env.returns))
    terms = info["reward_terms"]
    assert sum(float(t) for t in terms.values()) == pytest.approx(float(reward), abs=1e-5)


@pytest.mark.parametrize(
    ("env_id", "obs_mode"), [("HabPick-v1", "state_dict"), ("HabNavigate-v1", "state")]
)
def test_gymnasiums_checker_accepts_it(make, env_id, obs_mode):
    """Only that the states are not between -1 and 1, and have no bounds, may be noted.

    The check of closing makes the environment anew from its spec, which ManiSkill's time limit
    does not allow; closing twice is tried here.
    """
    env = CPUGymWrapper(make(env_id, obs_mode=obs_mode))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        check_env(env, skip_render_check=True, skip_close_check=True)
    serious = [str(w.message) for w in told if not _is_about_bounds(str(w.message))]
    assert not serious, serious
    env.close()
    env.close()


def _is_about_bounds(message):
    notes = ("infinity", "symmetric and normalized", "wrapper applied to it")
    return any(note in message for note in notes) or "mani_skill is not installed" in message


def one(env_id, file, **options):
    """Makes a plain environment in a worker process."""
    import hab_tasks  # noqa: F401

    return CPUGymWrapper(gym.make(env_id, **{"obs_mode": "state", "episodes": file, **options}))


@slow
def test_two_processes_play_what_one_plays(make, episode_files):
    env_id = "HabPick-v1"
    file = str(episode_files[env_id])
    makers = [lambda: one(env_id, file)] * 2
    single = CPUGymWrapper(make(env_id, obs_mode="state"))
    # Nothing is grasped, so that no episode ends.
    rows = [actions(single, 10, seed=row, gripper=-1.0) for row in range(2)]
    # "spawn", as threads and fork do not mix.
    pair = gym.vector.AsyncVectorEnv(makers, context="spawn")
    try:
        begun, _ = pair.reset(seed=[3, 4])
        both = [begun] + [pair.step(np.stack(a))[0] for a in zip(*rows, strict=True)]
    finally:
        pair.close()
    for row, seed in enumerate((3, 4)):
        alone = [single.reset(seed=seed)[0]] + [single.step(a)[0] for a in rows[row]]
        for step, (a, b) in enumerate(zip(both, alone, strict=True)):
            assert np.array_equal(a[row], b), f"row {row}, step {step}"


@slow
def test_stable_baselines_trains_on_it_unchanged(episode_files):
    env_id = "HabPick-v1"
    sb3 = pytest.importorskip("stable_baselines3")
    file = str(episode_files[env_id])
    env = one(env_id, file, reward_mode="normalized_dense")
    policy = sb3.PPO("MlpPolicy", env, n_steps=250, batch_size=50, seed=0, device="cpu")
    before = [p.detach().clone() for p in policy.policy.parameters()]
    policy.learn(500)
    assert policy.num_timesteps == 500
    after = list(policy.policy.parameters())
    assert any(not a.equal(b) for a, b in zip(after, before, strict=True))
    assert all(bool(p.isfinite().all()) for p in after)
    # What the recorder of episodes saw were whole ones.
    obs, _ = env.reset(seed=1)
    action, _ = policy.predict(obs, deterministic=True)
    assert env.action_space.contains(action if action.ndim else int(action))
    assert env.step(action)[0].shape == (whole_size(env_id),)
    env.close()


@each_family
def test_the_idle_action_is_one_of_the_space(make, env_id):
    env = CPUGymWrapper(make(env_id, obs_mode="state"))
    env.reset(seed=0)
    action = still(env)
    assert env.action_space.contains(int(action[0]) if action.shape == (1,) else action)
