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
    """Environments that tests play one after another: making one takes longer than most tests."""

    SIZE = 40

    def __init__(self) -> None:
        self._idle: dict[str, list[gym.Env]] = {}
        self._used: list[str] = []

    def take(self, key: str) -> gym.Env | None:
        """Returns one that nobody plays, None if there is none."""
        return self._idle[key].pop() if self._idle.get(key) else None

    def give_back(self, key: str, env: gym.Env) -> None:
        """Takes one that a test has played, unless the test closed it."""
        if env.unwrapped.scene is None:
            return
        self._idle.setdefault(key, []).append(env)
        self._used.append(key)
        while sum(map(len, self._idle.values())) > self.SIZE:
            oldest = self._used.pop(0)
            if self._idle[oldest]:
                self._idle[oldest].pop(0).close()

    def close(self) -> None:
        """Closes all."""
        for envs in self._idle.values():
            for env in envs:
                env.close()


@pytest.fixture(scope="session")
def env_pool():
    pool = EnvPool()
    yield pool
    pool.close()


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
