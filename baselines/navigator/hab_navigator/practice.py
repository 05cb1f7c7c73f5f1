"""Practice: the navigator plays training episodes, and their goals become lessons."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from hab_navigator.lessons import Lessons
from hab_navigator.navigator import REPEAT, Navigator, goal_in_map
from hab_navigator.network import GoalNetwork
from hab_navigator.weights import load
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
        self.navigator, self.episode = Navigator(network), episode
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


def _play(env: Any, network: GoalNetwork, plan: PracticePlan) -> Played:
    played = Played()
    seeds = np.random.default_rng(plan.seed).integers(2**31, size=plan.rows).tolist()
    obs, _ = env.reset(seed=seeds, options={"reconfigure": True})
    rows = [_Row(network, one[0]) for one in env.get_attr("episode")]
    left = np.full(plan.rows, plan.each)
    ended = np.zeros(plan.rows, dtype=bool)
    while left.any():
        actions = np.full(plan.rows, STOP_CELL)
        for number, row in enumerate(rows):
            if not ended[number] and left[number]:
                actions[number] = _act(row, number, obs, played)
        obs, _, terminated, truncated, info = env.step(actions)
        before, ended = ended, np.asarray(terminated | truncated)
        if before.any():  # these have started anew
            episodes = env.get_attr("episode")
            for number in np.flatnonzero(before):
                rows[number] = _Row(network, episodes[number][0])
        for number in np.flatnonzero(ended & (left > 0)):
            skill = rows[number].episode.navigation.skill
            played.solved.setdefault(skill, []).append(bool(info["success"][number]))
            left[number] -= 1
    return played


def _act(row: _Row, number: int, obs: Any, played: Played) -> int:
    """Returns a row's action; now and then keeps a lesson."""
    point_m = np.asarray(obs["extra"]["point_in_base"][number])
    holding = bool(np.asarray(obs["agent"]["is_holding"][number]).reshape(-1)[0] > 0)
    action = row.navigator.action(obs["sensor_data"]["head"]["depth"][number], point_m, holding)
    row.actions += 1
    if (row.actions + number) % EVERY_ACTIONS == 0:
        lesson = Lessons.of(row.navigator, float(point_m[2]), holding, row.goal)
        played.lessons.append(lesson)
    return action
