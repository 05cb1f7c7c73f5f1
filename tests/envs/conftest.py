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

KEPT_ENVS = 20
"""Each takes 3 MB, with images 10 MB (HabSetTable-v1)."""


@pytest.fixture(scope="session")
def episode_files(tmp_path_factory):
    """Env id -> a file with the first `COUNT` episodes of the shipped evaluation set."""
    folder, files = tmp_path_factory.mktemp("episodes"), {}
    for env_id in ENVS:
        whole = read_episodes(SHIPPED / f"{env_id}.apartment.embedded.val.0.json.gz")
        files[env_id] = folder / f"{env_id}.json"
        write_episodes(replace(whole, episodes=whole.episodes[:COUNT]), files[env_id])
    return files


@pytest.fixture(scope="session")
def idle_envs():
    """(options, environment) that tests have played, the least recently used first.

    Making an environment takes longer than most tests.
    """
    idle: list[tuple[str, gym.Env]] = []
    yield idle
    for _, env in idle:
        env.close()


@pytest.fixture
def make(episode_files, idle_envs, request):
    """Makes environments on these episodes, or hands out those that tests before have played.

    A test marked `new_env` gets new ones.
    """
    made = []
    new = request.node.get_closest_marker("new_env") is not None

    def make(env_id: str = "HabPick-v1", **options):
        episodes = episode_files[env_id.removeprefix("hab_tasks:")]
        options = {"episodes": episodes, **options}
        key = repr((env_id, sorted(options.items())))
        idle = (
            [] if new else [number for number, (known, _) in enumerate(idle_envs) if known == key]
        )
        env = idle_envs.pop(idle[0])[1] if idle else gym.make(env_id, **options)
        made.append((key, env))
        return env

    yield make
    for key, env in made:
        if new or " at 0x" in key:
            env.close()
        elif env.unwrapped.scene is not None:  # the test has not closed it
            idle_envs.append((key, env))
    while len(idle_envs) > KEPT_ENVS:
        idle_envs.pop(0)[1].close()
