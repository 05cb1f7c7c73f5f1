"""Random and adversarial steps in one environment, with checks of every value."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import psutil
from gymnasium import spaces
from torch import Tensor

from hab_tasks.envs import ENVS
from hab_tasks.episodes.source import shared_sources

PART_STEPS = 1000
"""An environment is used for so many steps, then one with other options."""

LONGEST_HOLD_STEPS = 40


@dataclass(frozen=True, kw_only=True)
class Soaked:
    """What a run of `soak` has done.

    Attributes:
        steps: Steps.
        episodes: Starts.
        half_bytes: Memory of this process after half of the steps.
        end_bytes: The same in the end.
    """

    steps: int
    episodes: int
    half_bytes: int
    end_bytes: int

    @property
    def growth(self) -> float:
        """How much the memory has grown in the second half, as a share."""
        return self.end_bytes / self.half_bytes - 1.0


def soak(env_id: str, dataset: dict[str, Any], steps: int, seed: int) -> Soaked:
    """Plays `steps` steps with changing options, actions and starts; raises at the first fault.

    Args:
        env_id: The environment.
        dataset: Options that choose scene dataset and objects.
        steps: How many steps.
        seed: Of everything that is drawn.
    """
    rng = np.random.default_rng(seed)
    done = episodes = half = 0
    with shared_sources():  # each episode is generated once for all environments
        while done < steps:
            part = min(PART_STEPS, steps - done)
            episodes += _part(env_id, {**dataset, **_options(env_id, rng)}, part, rng)
            done += part
            half = half if half and 2 * done > steps + PART_STEPS else _memory_bytes()
    return Soaked(steps=done, episodes=episodes, half_bytes=half, end_bytes=_memory_bytes())


def _options(env_id: str, rng: np.random.Generator) -> dict[str, Any]:
    """Draws options of an environment."""
    env = ENVS[env_id].env
    found: dict[str, Any] = {
        "obs_mode": str(rng.choice(["state", "state_dict", "none"])),
        "control_mode": str(rng.choice(env.control_modes)),
        "reward_mode": str(rng.choice(["dense", "normalized_dense", "sparse"])),
        "num_episodes": 10,
        "action_delay_steps": int(rng.choice([0, 0, 3])),
        "proprioception": bool(rng.integers(2)),
    }
    if rng.integers(2):
        found["sensor_noise"] = {"joint_rad": 0.01}
    if env.handle is not None:
        found["handle_position"] = bool(rng.integers(2))
    return found


def _part(env_id: str, options: dict[str, Any], steps: int, rng: np.random.Generator) -> int:
    """Plays `steps` steps in a new environment; returns the number of starts."""
    env = gym.make(f"hab_tasks:{env_id}", **options)
    starts = 0
    try:
        actions = _actions(env.action_space, rng)
        over = True
        for _ in range(steps):
            if over or rng.random() < 0.01:
                _check_reset(env, rng)
                starts += 1
            over = _check_step(env, next(actions))
    finally:
        env.close()
    return starts


def _check_reset(env: gym.Env[Any, Any], rng: np.random.Generator) -> None:
    how = rng.integers(4)
    number = int(rng.integers(10))
    options = {"episode": number} if how == 1 else {"reconfigure": True} if how == 2 else None
    obs, info = env.reset(seed=int(rng.integers(2**31)) if how else None, options=options)
    check_finite("obs", obs)
    check_finite("info", info)


def _check_step(env: gym.Env[Any, Any], action: Any) -> bool:
    obs, reward, terminated, truncated, info = env.step(action)
    for name, value in (("obs", obs), ("reward", reward), ("info", info)):
        check_finite(name, value)
    for flag in (terminated, truncated, info["success"]):
        assert np.asarray(flag).dtype == bool
    assert np.abs(np.asarray(reward)).max() < 1e6
    return bool(np.asarray(terminated).any()) or bool(np.asarray(truncated).any())


def check_finite(name: str, value: Any) -> None:
    """Asserts that every number in a nested value is finite."""
    if isinstance(value, dict):
        for key, entry in value.items():
            check_finite(f"{name}.{key}", entry)
    elif isinstance(value, list | tuple):
        for index, entry in enumerate(value):
            check_finite(f"{name}[{index}]", entry)
    elif isinstance(value, Tensor | np.ndarray | float | int):
        array = np.asarray(value)
        assert array.dtype == object or np.isfinite(array).all(), name


def _actions(space: gym.Space[Any], rng: np.random.Generator) -> Iterator[Any]:
    """Yields actions: by chance, held for a while, at and beyond the limits, back and forth."""
    if isinstance(space, spaces.Discrete):
        while True:
            held = int(rng.integers(space.n))
            for _ in range(int(rng.integers(1, LONGEST_HOLD_STEPS))):
                yield held
    assert isinstance(space, spaces.Box)
    while True:
        kind = rng.integers(5)
        held = rng.uniform(-1.0, 1.0, space.shape)
        for step in range(int(rng.integers(1, LONGEST_HOLD_STEPS))):
            fresh = rng.uniform(-1.0, 1.0, space.shape)
            action = (fresh, held, np.sign(held), np.sign(held) * (-1) ** step, 1e6 * fresh)[kind]
            yield action.astype(np.float32)


def _memory_bytes() -> int:
    return psutil.Process().memory_info().rss
