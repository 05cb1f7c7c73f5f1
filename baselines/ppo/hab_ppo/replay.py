"""Replay of a path in a recipe's own environment, with disturbed actions and clean labels.

The executed actions get noise, the label of each state is what the follower of the path would do
there (DART, arXiv 1703.09327). So the examples contain states beside the path, and the way back.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hab_ppo.examples import Examples
from hab_ppo.observation import Observation, ObservationLayout
from hab_ppo.retiming import Follower, Stretch
from hab_tasks.engine.rollout import EndRolloutError, EnvRow, Job, flag, play_one
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


class _Follower:
    """Follows a path with disturbed actions; keeps what it sees, with the clean ones."""

    def __init__(
        self, layout: ObservationLayout, path: list[Stretch], disturbance: Disturbance, size: int
    ) -> None:
        self._layout, self._disturbance, self._size = layout, disturbance, size
        self._follower, self._left = Follower(path), SETTLING_STEPS
        self.seen: list[Observation] = []
        self.labels: list[NDArray[np.float32]] = []

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """Does nothing: it plays one episode."""

    def act(self, obs: Any) -> Tensor:
        """Returns what is executed, (1, A)."""
        if not self._left:
            raise EndRolloutError
        ee_m = np.asarray(obs["agent"]["ee_position"][0], dtype=float)
        label = self._follower.act(ee_m, flag(obs["agent"]["is_holding"] > 0, 0))
        self.labels.append(label[: self._size].astype(np.float32))
        self.seen.append(self._layout.read(obs))
        self._left -= self._follower.finished
        return torch.from_numpy(self._disturbance.executed(self.labels[-1]))[None]


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
    disturbance.start(path[0].gripper)
    follower = _Follower(layout, path, disturbance, int(np.prod(env.action_space.shape or ())))
    outcome = play_one(EnvRow(env), follower, Job(0, episode))
    examples = Examples.of(follower.seen, np.stack(follower.labels))
    if outcome is None:
        return Replayed(ENDED, examples)
    return Replayed(None if outcome.success else outcome.failure or TIMEOUT, examples)
