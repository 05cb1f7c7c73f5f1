"""Episodes that every test of an environment plays, made once, and environments on them."""

import gymnasium as gym
import pytest
import torch

from hab_tasks.envs import ENVS
from hab_tasks.episodes import EpisodeRequest, open_source, write_episodes

torch.set_num_threads(1)
COUNT, SEED = 8, 2024


@pytest.fixture(scope="session")
def episode_files(tmp_path_factory):
    """Env id -> a file of `COUNT` episodes in the apartment."""
    folder, files = tmp_path_factory.mktemp("episodes"), {}
    with pytest.MonkeyPatch.context() as patch:
        # With an empty cache, so that nothing made by an older version is played.
        patch.setenv("HAB_CACHE_DIR", str(folder / "cache"))
        for env_id in ENVS:
            files[env_id] = folder / f"{env_id}.json"
            source = open_source(EpisodeRequest(env_id=env_id, seed=SEED))
            write_episodes(source.to_set(COUNT), files[env_id])
    return files


@pytest.fixture
def make(episode_files):
    """Makes environments on these episodes, and closes them."""
    made = []

    def make(env_id: str = "HabPick-v1", **options):
        env = gym.make(env_id, **{"episodes": episode_files[env_id], **options})
        made.append(env)
        return env

    yield make
    for env in made:
        env.close()
