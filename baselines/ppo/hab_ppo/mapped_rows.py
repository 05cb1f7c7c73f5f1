"""Vector environments whose observations have the robot's map in place of the images."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorWrapper
from numpy.typing import NDArray

from hab_ppo.map_memory import CHANNELS, SIDE_PX, MapMemory
from hab_ppo.observation import IMAGES
from hab_ppo.recipe import EnvConfig

MAP = "map"


def policy_rows(config: EnvConfig, **options: Any) -> Any:
    """Returns a vector environment with the observations and the actions of a policy.

    Args:
        config: The policy's environment.
        options: Options of `gymnasium.make_vec`.
    """
    repeat = config.action_repeat
    rows = gym.make_vec(config.reference, copy=False, action_repeat=repeat, **options)
    return MappedRows(rows, repeat) if config.map_memory else rows


class MappedRows(VectorWrapper[Any, Any, Any]):
    """A vector environment with `MapMemory`; otherwise as `HabVectorEnv`."""

    def __init__(self, env: Any, repeat: int) -> None:
        """Wraps an environment that executes each action `repeat` times."""
        super().__init__(env)
        self._maps = MapMemory(env.num_envs, repeat)
        self._ended = np.zeros(env.num_envs, dtype=bool)
        self._single_observation_space = mapped_space(env.single_observation_space)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """See `HabVectorEnv.reset`."""
        obs, info = self.env.reset(seed=seed, options=options)
        chosen = (options or {}).get("reset_mask")
        rows = np.ones_like(self._ended) if chosen is None else np.asarray(chosen)
        self._maps.forget(rows)
        self._ended[rows] = False
        return with_map(obs, self._maps.look(*seen_by_head(obs))), info

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """See `HabVectorEnv.step`."""
        obs, reward, terminated, truncated, info = self.env.step(actions)
        self._maps.turn(np.asarray(actions))
        self._maps.forget(self._ended)  # these rows have started anew
        self._ended = terminated | truncated
        obs = with_map(obs, self._maps.look(*seen_by_head(obs)))
        return obs, reward, terminated, truncated, info

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """See `HabVectorEnv.call`."""
        rows: Any = self.env
        return rows.call(name, *args, **kwargs)


class RowMaps:
    """Maps of rows that do not decide at the same time."""

    def __init__(self, repeat: int) -> None:
        """Creates maps for actions that are executed `repeat` times."""
        self._repeat = repeat
        self._maps: dict[int, MapMemory] = {}

    def forget(self, rows: Iterable[int]) -> None:
        """Empties the maps of some rows."""
        for row in rows:
            self._maps.pop(row, None)

    def look(
        self, rows: Sequence[int], obs: Mapping[str, Any], points_m: NDArray[Any]
    ) -> NDArray[np.uint8]:
        """Returns the maps (K, H, W, C) of some rows, with what they see now.

        Args:
            rows: Their numbers.
            obs: The observation of all rows.
            points_m: (K, 3) the points to go to, in the base frames.
        """
        images = np.zeros((len(rows), SIDE_PX, SIDE_PX, CHANNELS), dtype=np.uint8)
        depth = np.asarray(obs[IMAGES]["head"]["depth"])
        for number, row in enumerate(rows):
            maps = self._maps.setdefault(row, MapMemory(1, self._repeat))
            images[number] = maps.look(depth[[row]], points_m[[number]])[0]
        return images

    def turn(self, rows: Sequence[int], actions: NDArray[Any]) -> None:
        """Takes the actions (K, 1) of some rows into account."""
        for row, action in zip(rows, actions, strict=True):
            self._maps[row].turn(action)


def policy_space(config: EnvConfig, space: Any) -> Any:
    """Returns what a policy observes in an environment with this nested space of one row."""
    return mapped_space(space) if config.map_memory else space


def mapped_space(space: Any) -> spaces.Dict:
    """Returns a nested observation space of one row with a map in place of the images."""
    image = spaces.Box(0, 255, (SIDE_PX, SIDE_PX, CHANNELS), np.uint8)
    return spaces.Dict({**space.spaces, IMAGES: spaces.Dict({MAP: spaces.Dict({MAP: image})})})


def seen_by_head(obs: Mapping[str, Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Returns the depth images (N, H, W, 1) and the points (N, 3) of an observation of Navigate."""
    return np.asarray(obs[IMAGES]["head"]["depth"]), np.asarray(obs["extra"]["point_in_base"])


def with_map(obs: Mapping[str, Any], images: NDArray[np.uint8]) -> dict[str, Any]:
    """Returns an observation with maps (N, H, W, C) in place of the images."""
    return {**obs, IMAGES: {MAP: {MAP: images}}}
