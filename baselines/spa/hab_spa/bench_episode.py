"""Whole episodes by phase, as rows of suite plan of ``hab-eval bench``.

A phase's time is exclusive: what a base pose's choice spends on inverse kinematics counts as goals.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hab_eval.bench.report import BenchRow, bound_row, make_row
from hab_eval.bench.suite import WriteLine
from hab_eval.records.config import EvalConfig
from hab_eval.run.agents import load_agent
from hab_eval.run.environments import load_episode_set, setup_of
from hab_eval.run.rows import RolloutPlan, job_of, make_rows
from hab_eval.run.runner import play

from hab_spa.agents.agent import SpaAgent
from hab_spa.planning import joint_goal
from hab_spa.planning.arm_plan import BatchedPlanner, OmplPlanner
from hab_spa.planning.collision import ArmCollision
from hab_spa.scenes.seen_scene import SeenScene
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.skills.fridge.arc import Arcs
from hab_spa.skills.fridge.base_poses import BasePoseSearch
from hab_spa.tasks.planned_skills import PlannedSkill

SEED = 2039
Seconds = defaultdict[str, float]
"""Phase -> seconds."""

WHOLE, ENVIRONMENT, OTHER = "whole episode", "environment", "other"

PHASES: tuple[tuple[str, Any, str], ...] = (
    ("base_poses", BasePoseSearch, "choose"),
    ("base_poses", PlannedSkill, "base_pose"),
    ("arc", Arcs, "candidates"),
    ("look", SeenScene, "look"),
    ("map", TrueScene, "_map"),
    ("model", ArmCollision, "__init__"),
    ("goals", joint_goal, "_goals_near"),
    ("goals", joint_goal, "found_by"),
    ("paths", OmplPlanner, "plan"),
    ("paths", BatchedPlanner, "plan"),
    (OTHER, SpaAgent, "act"),
    (OTHER, SpaAgent, "reset"),
)
"""Name, class or module, function."""


@dataclass(frozen=True, kw_only=True)
class Timed:
    """Episodes that are timed.

    Attributes:
        agent, env: Names.
        options: The agent's.
        episodes: Number of episodes.
        planning_bound_s: Bound of what the phases but "other" take in an episode, if any ...
        bound_s: ... and of the whole episode.
    """

    agent: str
    env: str
    options: dict[str, str]
    episodes: int
    planning_bound_s: float | None = None
    bound_s: float | None = None


BATCHED = {"planner": "batched"}
EPISODES = (
    Timed(
        agent="spa_priv",
        env="HabOpenFridge-v1",
        options=BATCHED,
        episodes=20,
        planning_bound_s=0.4,
    ),
    Timed(agent="spa", env="HabPick-v1", options=BATCHED, episodes=5),
    Timed(agent="tp_spa_priv", env="HabSetTable-v1", options=BATCHED, episodes=2, bound_s=12.0),
)


class _Clock:
    """Seconds of each phase, without those of the phases that it calls."""

    def __init__(self) -> None:
        self.seconds: Seconds = defaultdict(float)
        self._running, self._since = [ENVIRONMENT], time.perf_counter()

    def turn(self) -> None:
        """Adds the time since the last call to the phase that runs."""
        now = time.perf_counter()
        self.seconds[self._running[-1]] += now - self._since
        self._since = now

    def timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Returns a function whose calls are the phase `name`."""

        def call(*args: Any, **settings: Any) -> Any:
            self.turn()
            self._running.append(name)
            try:
                return function(*args, **settings)
            finally:
                self.turn()
                self._running.pop()

        return call


@contextmanager
def _timed() -> Iterator[_Clock]:
    """Times the phases in the context."""
    clock = _Clock()
    with ExitStack() as stack:
        for name, owner, function in PHASES:
            original = getattr(owner, function)
            setattr(owner, function, clock.timed(name, original))
            stack.callback(setattr, owner, function, original)
        yield clock


def episode_rows(
    write_line: WriteLine, timed: tuple[Timed, ...] = EPISODES, count: int | None = None
) -> list[BenchRow]:
    """Returns the rows of episodes in the apartment, at most `count` of each kind."""
    rows: list[BenchRow] = []
    for one in timed:
        times = _times(one, min(one.episodes, count or one.episodes))
        write_line(f"suite plan, {one.agent} in {one.env}: {len(times)} episodes")
        rows += phase_rows(one, times)
    return rows


def phase_rows(timed: Timed, times: list[Seconds]) -> list[BenchRow]:
    """Returns the rows of the seconds of episodes, in all and by phase."""
    name = "plan", "apartment", timed.env
    whole = [sum(seconds.values()) for seconds in times]
    planning = [
        total - seconds[ENVIRONMENT] - seconds[OTHER]
        for total, seconds in zip(whole, times, strict=True)
    ]
    rows = []
    for part, values, bound in (
        ("planning", planning, timed.planning_bound_s),
        ("episode", whole, timed.bound_s),
    ):
        label = (*name, f"{timed.agent}_{part}")
        rows.append(
            make_row(label, values, whole, unit="s/episode", reference=WHOLE)
            if bound is None
            else bound_row(label, values, bound, unit="s/episode")
        )
    for phase in sorted({phase for seconds in times for phase in seconds}):
        values = [seconds[phase] for seconds in times]
        label = (*name, f"{timed.agent}_{phase}")
        rows.append(make_row(label, values, whole, unit="s/episode", reference=WHOLE))
    return rows


def _times(timed: Timed, count: int) -> list[Seconds]:
    """Plays an episode to warm up, then others; returns the seconds of their phases."""
    factory = f"hab_spa:{timed.agent}"
    config = EvalConfig(
        agent=factory, env=timed.env, split="test", seed=SEED, options=timed.options,
        episodes=count + 1,
    )  # fmt: skip
    episodes = load_episode_set(config, None, 1).episodes
    agent = load_agent(factory, setup_of(config))
    plan = RolloutPlan(config=config, split="test", out=Path(), videos=0)
    times = []
    with closing(make_rows(plan, agent.spec, 1)) as rows:
        for index, episode in enumerate(episodes):
            with _timed() as clock:
                for _ in play(agent, rows, iter([job_of(index, episode)])):
                    clock.turn()
            times.append(clock.seconds)
    return times[1:]
