"""Practice: the navigator plays training episodes, and their goals become lessons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from hab_ppo.rows import VectorRows
from numpy.typing import NDArray
from torch import Tensor

from hab_navigator.lessons import Lessons
from hab_navigator.navigator import REPEAT, Navigator, goal_in_map
from hab_navigator.network import GoalNetwork, load
from hab_tasks.engine.rollout import EndRolloutError, Job, flag, play
from hab_tasks.envs import ENVS
from hab_tasks.robots.control_modes import STOP_CELL
from hab_tasks.skills.navigate import NAVIGATE_ID

EVERY_ACTIONS = 12
"""A lesson is taken every so many actions, and the first time after so many as the row's number."""


@dataclass(frozen=True, kw_only=True)
class PracticePlan:
    """What a process plays.

    Attributes:
        weights: File of the network's weights; None to begin without any.
        scene_dataset: Layouts.
        objects: Folder of the objects; None for the dataset's own.
        num_episodes: Number of training episodes.
        rows: Number of simulations.
        each: Episodes of each.
        seed: Seed of the rows.
    """

    weights: Path | None
    scene_dataset: str
    objects: str | None
    num_episodes: int
    rows: int
    each: int
    seed: list[int]


@dataclass(kw_only=True)
class Played:
    """What came of it.

    Attributes:
        lessons: Lessons, of which each may hold many.
        solved: By the skill whose start the goal is: whether each episode was solved.
    """

    lessons: list[Lessons] = field(default_factory=list)
    solved: dict[str, list[bool]] = field(default_factory=dict)

    @classmethod
    def joined(cls, several: list[Played]) -> Played:
        """Returns what several processes played."""
        whole = cls(lessons=[lesson for played in several for lesson in played.lessons])
        for played in several:
            for skill, solved in played.solved.items():
                whole.solved.setdefault(skill, []).extend(solved)
        return whole


class _Row:
    """An episode that is being played."""

    def __init__(self, network: GoalNetwork, episode: Any) -> None:
        self.navigator, self.episode = Navigator(ENVS[NAVIGATE_ID].env.robot, network), episode
        self.actions = 0
        start, goal = np.array(episode.robot.base), np.array(episode.navigation.base)
        self.goal = goal_in_map(start, goal)


def practise(plan: PracticePlan) -> Played:
    """Plays in a process of its own."""
    network = GoalNetwork().eval() if plan.weights is None else load(plan.weights)[0]
    env: Any = gym.make_vec(
        f"hab_tasks:{NAVIGATE_ID}",
        num_envs=plan.rows,
        num_workers=1,
        copy=False,
        action_repeat=REPEAT,
        obs_mode="depth",
        control_mode="base_discrete",
        split="train",
        scene_dataset=plan.scene_dataset,
        objects=plan.objects,
        num_episodes=plan.num_episodes,
    )
    try:
        played = _play(env, network, plan)
    finally:
        env.close()
    # Each tensor that another process gets is an open file there.
    played.lessons = [Lessons.joined(played.lessons)] if played.lessons else []
    return played


class _Practice:
    """Acts in each row as its navigator does, until each has played its episodes."""

    def __init__(self, env: Any, rows: VectorRows, network: GoalNetwork, each: int) -> None:
        self._env, self._vector, self._network = env, rows, network
        self._rows: dict[int, _Row] = {}
        self._left = np.full(rows.count, each)
        self.played = Played()

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """Does nothing: the rows tell which episodes have started."""

    def act(self, obs: Any) -> NDArray[np.int64]:
        """Returns an action per row."""
        if not self._left.any():
            raise EndRolloutError
        fresh = np.flatnonzero(self._vector.fresh).tolist()
        episodes = self._env.get_attr("episode") if fresh else ()
        self._rows |= {number: _Row(self._network, episodes[number][0]) for number in fresh}
        actions = np.full(self._vector.count, STOP_CELL)
        for number in np.flatnonzero(~self._vector.over & (self._left > 0)).tolist():
            actions[number] = self._action(number, obs)
        return actions

    def _action(self, number: int, obs: Any) -> int:
        """Returns a row's action; now and then keeps a lesson."""
        row = self._rows[number]
        point_m = np.asarray(obs["extra"]["point_in_base"][number])
        holding = flag(obs["agent"]["is_holding"][number] > 0, 0)
        action = row.navigator.action(obs["sensor_data"]["head"]["depth"][number], point_m, holding)
        row.actions += 1
        if (row.actions + number) % EVERY_ACTIONS == 0:
            lesson = Lessons.of(row.navigator, float(point_m[2]), holding, row.goal)
            self.played.lessons.append(lesson)
        return action

    def end(self, number: int, solved: bool) -> None:
        """Counts an episode, unless the row has played enough."""
        if self._left[number]:
            skill = self._rows[number].episode.navigation.skill
            self.played.solved.setdefault(skill, []).append(solved)
            self._left[number] -= 1


def _play(env: Any, network: GoalNetwork, plan: PracticePlan) -> Played:
    seeds = np.random.default_rng(plan.seed).integers(2**31, size=plan.rows).tolist()
    rows = VectorRows(env, seeds)
    practice = _Practice(env, rows, network, plan.each)
    for ended in play(rows, practice, map(Job, count())):
        practice.end(ended.row, ended.outcome.success)
    return practice.played
