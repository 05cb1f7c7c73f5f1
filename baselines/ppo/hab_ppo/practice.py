"""Practice: DAgger (arXiv 1011.0686) with the followers of demonstrated paths as teachers.

A clone that leaves the states of the demonstrations knows no way back. So it plays the demonstrated
episodes itself, and the follower of each path labels the states that it visits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hab_ppo.actions import ActionNoise, Noise
from hab_ppo.distillation import Recorder, Visits
from hab_ppo.examples import Examples
from hab_ppo.network import Policy
from hab_ppo.replay import SETTLING_STEPS
from hab_ppo.retiming import Follower, Stretch
from hab_ppo.rows import Student
from hab_tasks.engine.rollout import Job, VectorRows, flag, play
from hab_tasks.episodes import Episode


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
