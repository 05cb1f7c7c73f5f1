"""Replay of a path in a recipe's own environment, with disturbed actions and clean labels.

The executed actions get noise, the label of each state is what the follower of the path would do
there (DART, arXiv 1703.09327). So the examples contain states beside the path, and the way back.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray

from hab_ppo.examples import Examples
from hab_ppo.observation import Observation, ObservationLayout
from hab_ppo.retiming import Follower, Stretch
from hab_tasks.episodes import Episode

DRIVING_MODE = "ee_base"
MODES = ("ee", DRIVING_MODE)
"""Control modes into which a path can be retimed."""

BLOCK_STEPS = 5
"""Steps over which a disturbance stays the same; noise that changes in each would cancel out."""

DISTURBED_SHARE = 0.5
"""Share of these blocks that have a disturbance."""

LATE_SHARE = 0.7
"""Probability that a change of the gripper waits for another step: the clone has to see the
states in which it is due more than once."""

SETTLING_STEPS = 10
"""Steps after the end of the path in which the episode may still succeed."""

ENDED = "path ended"
TIMEOUT = "timeout"


class Disturbance:
    """Adds noise to actions of ``ee`` and ``ee_base``."""

    def __init__(self, std: float, drawn: np.random.Generator) -> None:
        """Creates the noise of an episode: `std` is a share of the largest action."""
        self._std, self._drawn = std, drawn
        self._offset, self._steps, self._gripper = np.zeros(3), 0, -1.0

    def start(self, gripper: float) -> None:
        """Sets the gripper's value at the start of the episode."""
        self._gripper = gripper

    def executed(self, action: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns what is executed instead of an action (A,); without noise, the action."""
        if self._std <= 0:
            return action
        if self._steps % BLOCK_STEPS == 0:
            disturbed = self._drawn.random() < DISTURBED_SHARE
            self._offset = self._drawn.normal(0.0, self._std, 3) * disturbed
        self._steps += 1
        result = action.copy()
        result[:3] = np.clip(action[:3] + self._offset, -1, 1)
        if action[3] != self._gripper and self._drawn.random() < LATE_SHARE:
            result[3] = self._gripper
        self._gripper = float(result[3])
        return result


class Replayed(NamedTuple):
    """A replay: its failure, None if it succeeded, and its examples."""

    failure: str | None
    examples: Examples


def replay(
    env: gym.Env[Any, Any],
    layout: ObservationLayout,
    episode: Episode,
    path: list[Stretch],
    disturbance: Disturbance,
) -> Replayed:
    """Follows a path in an episode, in a simulation built anew.

    Args:
        env: A single environment with control mode ``ee`` or ``ee_base``.
        layout: What the policy observes in it.
        episode: The episode.
        path: The path.
        disturbance: Noise on the executed actions.
    """
    follower, size = Follower(path), int(np.prod(env.action_space.shape or ()))
    disturbance.start(path[0].gripper)
    obs, info = env.reset(seed=episode.seed, options={"episode": episode, "reconfigure": True})
    seen: list[Observation] = []
    labels: list[NDArray[np.float32]] = []
    left, over, failure = SETTLING_STEPS, False, ENDED
    while left and not over:
        ee_m = np.asarray(obs["agent"]["ee_position"][0], dtype=float)
        holding = bool(np.asarray(obs["agent"]["is_holding"]).reshape(-1)[0] > 0)
        label = follower.act(ee_m, holding)[:size].astype(np.float32)
        seen.append(layout.read(obs))
        labels.append(label)
        executed = torch.from_numpy(disturbance.executed(label))[None]
        obs, _, terminated, truncated, info = env.step(executed)
        over = _first(terminated) or _first(truncated)
        left -= follower.finished
    if over:
        failure = None if _first(info["success"]) else _failure(info)
    return Replayed(failure, Examples.of(seen, np.stack(labels)))


def _failure(info: Mapping[str, Any]) -> str:
    """Returns the environment's failure category of an episode that was not solved."""
    named = [name for name, value in info.get("failures", {}).items() if _first(value)]
    return named[0] if named else TIMEOUT


def _first(value: Any) -> bool:
    """Returns the only row of a flag."""
    return bool(np.asarray(value).reshape(-1)[0])
