"""Episodes that every test of an environment plays, and environments on them."""

from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import pytest
import torch

from hab_tasks.envs import ENVS
from hab_tasks.episodes.schema import read_episodes, write_episodes

torch.set_num_threads(1)
SHIPPED = Path(__file__).parents[2] / "assets" / "episodes"
COUNT = 8


@pytest.fixture(scope="session")
def episode_files(tmp_path_factory):
    """Env id -> a file with the first `COUNT` episodes of the shipped evaluation set."""
    folder, files = tmp_path_factory.mktemp("episodes"), {}
    for env_id in ENVS:
        whole = read_episodes(SHIPPED / f"{env_id}.apartment.embedded.val.0.json.gz")
        files[env_id] = folder / f"{env_id}.json"
        write_episodes(replace(whole, episodes=whole.episodes[:COUNT]), files[env_id])
    return files


@pytest.fixture
def make(episode_files):
    """Makes environments on these episodes, and closes them."""
    made = []

    def make(env_id: str = "HabPick-v1", **options):
        episodes = episode_files[env_id.removeprefix("hab_tasks:")]
        env = gym.make(env_id, **{"episodes": episodes, **options})
        made.append(env)
        return env

    yield make
    for env in made:
        env.close()
