"""Replay of a path in a recipe's own environment, with disturbed actions and clean labels.

The executed actions get noise, the label of each state is what the follower of the path would do
there (DART, arXiv 1703.09327). So the examples contain states beside the path, and the way back.

A clone that leaves them knows no way back. In practice (DAgger, arXiv 1011.0686) it plays the
demonstrated episodes itself, and the follower of each path labels the states that it visits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hab_ppo.actions import ActionNoise, Noise
from hab_ppo.distillation import Recorder, Visits
from hab_ppo.examples import Examples
from hab_ppo.network import Policy
from hab_ppo.observation import Observation, ObservationLayout
from hab_ppo.retiming import Follower, Stretch
from hab_ppo.rows import Student, VectorRows
from hab_tasks.engine.rollout import EndRolloutError, EnvRow, Job, flag, play, play_one
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


class Lesson(NamedTuple):
    """An episode, and a path that solves it."""

    episode: Episode
    path: list[Stretch]


class _Teacher:
    """Labels the states of an episode as long as its path tells what to do."""

    def __init__(self, path: list[Stretch]) -> None:
        self._follower, self._left = Follower(path), SETTLING_STEPS

    def label(self, ee_m: Any, holding: bool, size: int) -> Any:
        """Returns the action (size,); None if the path is over or what it moves was lost."""
        action = self._follower.act(ee_m, holding)[:size].astype(np.float32)
        self._left -= self._follower.finished
        return None if self._left < 0 or self._follower.has_lost else action


class _Pupil(Student):
    """Plays lessons; every state that it visits gets the label of the lesson's path."""

    def __init__(
        self, student: Policy, rows: VectorRows, noise: Noise, lessons: Sequence[Lesson]
    ) -> None:
        super().__init__(student, rows, noise)
        self._lessons, self.recorder = lessons, Recorder(rows.count)
        self._teachers: dict[int, _Teacher] = {}

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """Starts lessons, whose numbers are the seeds."""
        for row in np.flatnonzero(mask).tolist():
            self._teachers[row] = _Teacher(self._lessons[seeds[row]].path)

    def act(self, obs: Any) -> NDArray[Any]:
        """Labels the states of the rows whose path tells what to do; acts as the student."""
        count, size = self.rows.count, self.policy.head.size
        labels, valid = np.zeros((count, size), np.float32), np.zeros(count, dtype=bool)
        for row, teacher in self._teachers.items():
            ee_m = np.asarray(obs["agent"]["ee_position"][row], dtype=float)
            holding = flag(obs["agent"]["is_holding"][row] > 0, 0)
            label = teacher.label(ee_m, holding, size)
            if label is not None:
                labels[row], valid[row] = label, True
        seen = self.policy.layout.read(obs)
        self.recorder.put(seen, labels, valid)
        return self.choose(seen)

    def end(self, row: int) -> list[Examples]:
        """Ends the lesson of a row; returns its examples."""
        del self._teachers[row]
        return self.recorder.ended([row])


def practise(student: Policy, lessons: Sequence[Lesson], env: Any, seed: list[int]) -> Visits:
    """Plays each lesson once; returns the visited states with their labels.

    Args:
        student: Acts with noise.
        lessons: The lessons.
        env: The student's vector environment, in autoreset mode `NEXT_STEP`; its rows have to be
            reset afterwards.
        seed: Seed of the noise.
    """
    generator = torch.Generator(device=student.state_normalizer.mean.device)
    generator.manual_seed(int(np.random.default_rng(seed).integers(2**31)))
    rows, visits = VectorRows(env), Visits()
    pupil = _Pupil(student, rows, ActionNoise(generator), lessons)
    jobs = (Job(number, lesson.episode, number) for number, lesson in enumerate(lessons))
    for ended in play(rows, pupil, jobs):
        visits.count(ended.outcome, pupil.end(ended.row))
    return visits
