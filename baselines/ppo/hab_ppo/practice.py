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

from hab_ppo.distillation import Recorder, Visits
from hab_ppo.evaluation import evaluate
from hab_ppo.examples import Examples
from hab_ppo.network import Policy
from hab_ppo.noise import ActionNoise
from hab_ppo.observation import Observation
from hab_ppo.replay import SETTLING_STEPS
from hab_ppo.retiming import Follower, Stretch
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


class _Class:
    """Labels every state that is visited in the lessons."""

    def __init__(self, lessons: Sequence[Lesson], rows: int, size: int) -> None:
        """Creates the teachers of `lessons`; labels have `size` entries."""
        self._teachers = [_Teacher(lesson.path) for lesson in lessons]
        self._recorder, self._size = Recorder(rows), size
        self.parts: list[Examples] = []

    def before_step(self, playing: Sequence[int | None], obs: Any, seen: Observation) -> None:
        """Labels the states of the rows whose path tells what to do."""
        labels = np.zeros((len(playing), self._size), np.float32)
        valid = np.zeros(len(playing), dtype=bool)
        for row, number in enumerate(playing):
            if number is not None:
                ee_m = np.asarray(obs["agent"]["ee_position"][row], dtype=float)
                holding = bool(np.asarray(obs["agent"]["is_holding"][row]).reshape(-1)[0] > 0)
                label = self._teachers[number].label(ee_m, holding, self._size)
                if label is not None:
                    labels[row], valid[row] = label, True
        self._recorder.put(seen, labels, valid)

    def after_step(self, ended: NDArray[np.bool_]) -> None:
        """Keeps the episodes that ended."""
        self.parts += self._recorder.ended(ended)


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
    lesson = _Class(lessons, env.num_envs, student.head.size)
    episodes = [one.episode for one in lessons]
    scores = evaluate(env, student, episodes, ActionNoise(generator), lesson)
    return Visits(
        parts=lesson.parts, episodes=len(scores), successes=sum(score.success for score in scores)
    )
