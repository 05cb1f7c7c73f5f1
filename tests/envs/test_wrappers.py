"""Common wrappers of ManiSkill and Gymnasium."""

import warnings
from contextlib import closing

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from mani_skill.utils.wrappers.gymnasium import CPUGymWrapper
from playing import actions, slow


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
    notes = ("infinity", "symmetric and normalized", "wrapper applied to it")
    notes += ("mani_skill is not installed",)
    assert not [w for w in told if not any(note in str(w.message) for note in notes)]
    env.close()
    env.close()


@pytest.mark.parametrize("kind", ["sync", pytest.param("async", marks=slow)])
def test_gymnasiums_vector_envs_play_what_one_plays(make, episode_files, kind):
    """In one process and in two; "spawn", as threads and fork do not mix."""

    def one():
        options = {"obs_mode": "state", "episodes": str(episode_files["HabPick-v1"])}
        return CPUGymWrapper(gym.make("hab_tasks:HabPick-v1", **options))

    single = CPUGymWrapper(make(obs_mode="state"))
    # Nothing is grasped, so that no episode ends.
    rows = [actions(single, 10, seed=row, gripper=-1.0) for row in range(2)]
    options = {"context": "spawn"} if kind == "async" else {}
    classes = {"sync": gym.vector.SyncVectorEnv, "async": gym.vector.AsyncVectorEnv}
    with closing(classes[kind]([one] * 2, **options)) as pair:
        begun, _ = pair.reset(seed=[3, 4])
        both = [begun] + [pair.step(np.stack(a))[0] for a in zip(*rows, strict=True)]
    for row, seed in enumerate((3, 4)):
        alone = [single.reset(seed=seed)[0]] + [single.step(a)[0] for a in rows[row]]
        assert np.array_equal([step[row] for step in both], alone)
