"""Shared episodes and environments of the tests."""

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


class EnvPool:
    """Environments that tests play one after another: making one takes longer than most tests.

    Each takes 3 MB, with images 10 MB (HabSetTable-v1). The least recently used is closed first.
    """

    SIZE = 20

    def __init__(self) -> None:
        self._idle: list[tuple[str, gym.Env]] = []

    def take(self, key: str) -> gym.Env | None:
        """Returns one that nobody plays, None if there is none."""
        for number, (known, env) in enumerate(self._idle):
            if known == key:
                del self._idle[number]
                return env
        return None

    def give_back(self, key: str, env: gym.Env) -> None:
        """Takes one that a test has played, unless the test closed it."""
        if env.unwrapped.scene is None:
            return
        self._idle.append((key, env))
        self.keep(self.SIZE)

    def keep(self, count: int) -> None:
        """Closes all but the `count` most recently used."""
        while len(self._idle) > count:
            self._idle.pop(0)[1].close()


@pytest.fixture(scope="session")
def env_pool():
    pool = EnvPool()
    yield pool
    pool.keep(0)


@pytest.fixture
def make(episode_files, env_pool, request):
    """Makes environments on these episodes, or hands out those that tests before have played.

    A test marked `new_env` gets new ones.
    """
    made = []
    new = request.node.get_closest_marker("new_env") is not None

    def make(env_id: str = "HabPick-v1", **options):
        episodes = episode_files[env_id.removeprefix("hab_tasks:")]
        options = {"episodes": episodes, **options}
        key = repr((env_id, sorted(options.items())))
        env = (None if new else env_pool.take(key)) or gym.make(env_id, **options)
        made.append((key, env))
        return env

    yield make
    for key, env in made:
        if new or " at 0x" in key:
            env.close()
        else:
            env_pool.give_back(key, env)
