"""A small vector environment in autoreset mode NEXT_STEP: walk along a line to a goal."""

from typing import Any

import numpy as np
from gymnasium import spaces

LIMIT = 12


def box(size: int) -> spaces.Box:
    return spaces.Box(-np.inf, np.inf, (size,), np.float32)


class ToyVector:
    """Rows that walk 0.2 a step at most; success within 0.1 of the goal, truncated at LIMIT."""

    def __init__(self, num_envs: int, *, discrete: bool = False, images: bool = False) -> None:
        self.num_envs, self.discrete, self.images = num_envs, discrete, images
        parts: dict[str, Any] = {
            "agent": spaces.Dict({"position": box(1)}),
            "extra": spaces.Dict({"goal": box(1)}),
        }
        if images:
            cameras = {
                "head": spaces.Dict({"depth": spaces.Box(0, 1, (36, 36, 1), np.float32)}),
                "arm": spaces.Dict({"rgb": spaces.Box(0, 255, (36, 36, 3), np.uint8)}),
            }
            parts["sensor_data"] = spaces.Dict(cameras)
        self.single_observation_space = spaces.Dict(parts)
        walk = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.single_action_space = spaces.Discrete(3) if discrete else walk
        self.position, self.goal = np.zeros(num_envs), np.zeros(num_envs)
        self.length = np.zeros(num_envs, dtype=int)
        self.ended = np.zeros(num_envs, dtype=bool)
        self.drawn = [np.random.default_rng(row) for row in range(num_envs)]
        self.closed = False

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> Any:
        options = options or {}
        if seed is not None:
            self.drawn = [np.random.default_rng(one) for one in seed]
        for row in np.flatnonzero(options.get("reset_mask", np.ones(self.num_envs, bool))):
            self._start(row, options.get("episode", [None] * self.num_envs)[row])
        return self._obs(), {}

    def _start(self, row: int, goal: float | None = None) -> None:
        self.position[row], self.length[row], self.ended[row] = 0.0, 0, False
        self.goal[row] = self.drawn[row].uniform(-1, 1) if goal is None else goal

    def step(self, actions: Any) -> Any:
        assert np.asarray(actions).shape == (
            (self.num_envs,) if self.discrete else (self.num_envs, 1)
        )
        moves = np.asarray(actions).reshape(-1) - 1 if self.discrete else np.asarray(actions)[:, 0]
        dead = self.ended.copy()
        before = np.abs(self.goal - self.position)
        self.position = np.where(dead, self.position, self.position + 0.2 * np.clip(moves, -1, 1))
        self.length += ~dead
        after = np.abs(self.goal - self.position)
        success = (after < 0.1) & ~dead
        truncated = (self.length >= LIMIT) & ~success & ~dead
        reward = np.where(dead, 0.0, before - after + success)
        self.ended = success | truncated
        for row in np.flatnonzero(dead):
            self._start(row)
        return self._obs(), reward, success, truncated, {"success": success}

    def _obs(self) -> Any:
        def column(values: Any) -> Any:
            return values.astype(np.float32)[:, None].copy()

        obs = {"agent": {"position": column(self.position)}, "extra": {"goal": column(self.goal)}}
        if self.images:
            depth = np.ones((self.num_envs, 36, 36, 1), np.float32) * self.goal[:, None, None, None]
            rgb = np.full((self.num_envs, 36, 36, 3), 7, np.uint8)
            obs["sensor_data"] = {"head": {"depth": depth.astype(np.float32)}, "arm": {"rgb": rgb}}
        return obs

    def close(self) -> None:
        self.closed = True


def goals(count: int) -> tuple[float, ...]:
    """Goals of an evaluation, given to `reset` as episodes."""
    return tuple(np.linspace(-0.9, 0.9, count).tolist())
