"""Motion plans of the arm between an open and a tight end (S App. D).

Each pair of ends is tried in three ways, the cheapest first: a straight line in joint space;
the gripper drawn straight out of the tight end, then on by a straight line or by RRTConnect;
RRTConnect from end to end. Runs of RRTConnect are short and start again with new random
numbers, because their running time has a long tail.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count

import numpy as np

from hab_spa.collision import ArmCollision
from hab_spa.escape import EscapeConfig, retreats
from hab_spa.ik import BatchArm
from hab_spa.results import Failure, PathResult
from hab_spa.rrt import Limit, RrtConfig, connect, edge_is_free, shorten
from hab_spa.shapes import Array


@dataclass(frozen=True, kw_only=True)
class PlanConfig:
    """The motion planner's numbers.

    Attributes:
        time_limit_s: All attempts together take at most this long (S App. D).
        margins_m: Wanted clearances of the attempts, one after the other.
        first_checks: The first runs of RRTConnect give up after this many collision checks;
            the next round of runs after twice as many, and so on.
        good_rad: A path this short (largest joint, summed over its edges) is not improved on.
        improve_checks: While fewer checks than this were spent, a longer path is improved on.
        rrt: Numbers of one run.
        retreat: Numbers of drawing the gripper out.
    """

    time_limit_s: float = 30.0
    margins_m: tuple[float, ...] = (0.02, 0.01, 0.003)
    first_checks: int = 4_000
    good_rad: float = 2.5
    improve_checks: int = 12_000
    rrt: RrtConfig = field(default_factory=RrtConfig)
    retreat: EscapeConfig = field(default_factory=EscapeConfig)


@dataclass(frozen=True, kw_only=True, eq=False)
class Ends:
    """Arm poses (7,) [rad] to connect; the tight one is where obstacles are near."""

    open: Array
    tight: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class _Attempt:
    """One way to connect; `checks` is 0 for the straight ways."""

    margin_m: float
    ends: Ends
    through_retreat: bool
    checks: int


def plan_path(
    collision: ArmCollision,
    arm: BatchArm,
    ends: Sequence[Ends],
    seed: int,
    config: PlanConfig,
    touch_m: float = 0.001,
) -> PathResult:
    """Plans from the open to the tight end of one of `ends`, the first where possible.

    Pairs of shapes that an end brings closer than the margin may stay that close along the
    path; all other pairs keep the margin.

    Args:
        collision: Tells which arm poses are free; its margins are changed.
        arm: Kinematics.
        ends: What to connect, best first.
        seed: Same arguments and seed, same path, unless the time limit strikes.
        config: The planner's numbers.
        touch_m: Pairs that are too close at an end may come this much closer still.
    """
    began, checks_before = time.perf_counter(), collision.checks
    deadline_s = began + config.time_limit_s
    best: Array | None = None
    for i, attempt in enumerate(_attempts(ends, config)):
        spent = collision.checks - checks_before
        if time.perf_counter() >= deadline_s:
            break
        if best is not None and (
            path_rad(best) <= config.good_rad or spent >= config.improve_checks
        ):
            break
        collision.set_margin(attempt.margin_m)
        collision.relax(attempt.ends.open, touch_m)
        collision.relax(attempt.ends.tight, touch_m)
        path = _run(collision, arm, attempt, seed + i, deadline_s, config)
        if path is not None and len(path) > 2:
            path = shorten(collision, path, seed + i, deadline_s, config.rrt)
        if path is not None and (best is None or path_rad(path) < path_rad(best)):
            best = path
    return PathResult(
        path=best,
        failure=Failure.MOTION_PLAN if best is None else None,
        seconds=time.perf_counter() - began,
        checks=collision.checks - checks_before,
    )


def path_rad(path: Array) -> float:
    """Length of a path (K, 7): the largest joint displacement of each edge, summed."""
    return float(np.abs(np.diff(path, axis=0)).max(axis=1).sum())


def _attempts(ends: Sequence[Ends], config: PlanConfig) -> Iterator[_Attempt]:
    """All straight ways first, then rounds of ever longer runs of RRTConnect without end."""
    for power in count(-1):
        checks = 0 if power < 0 else config.first_checks * 2**power
        for margin_m in config.margins_m:
            for pair in ends:
                for through_retreat in (True, False) if checks else (False, True):
                    yield _Attempt(
                        margin_m=margin_m,
                        ends=pair,
                        through_retreat=through_retreat,
                        checks=checks,
                    )


def _run(
    collision: ArmCollision,
    arm: BatchArm,
    attempt: _Attempt,
    seed: int,
    deadline_s: float,
    config: PlanConfig,
) -> Array | None:
    first, last = attempt.ends.open, attempt.ends.tight
    limit = Limit(checks=attempt.checks, deadline_s=deadline_s)
    if not attempt.through_retreat:
        if attempt.checks:
            return connect(collision, first, last, seed, limit, config.rrt)
        free = edge_is_free(collision, first, last, config.rrt.resolution_rad)
        return np.stack((first, last)) if free else None
    ways = retreats(collision, arm, last, config.retreat)
    if not attempt.checks:
        return _shortest(_straight_to(collision, first, way, config) for way in ways)
    if not ways:
        return None
    longest = max(ways, key=len)
    path = connect(collision, first, longest[-1], seed, limit, config.rrt)
    return None if path is None else np.concatenate((path, longest[-2::-1]))


def _straight_to(
    collision: ArmCollision, first: Array, way: Array, config: PlanConfig
) -> Array | None:
    """From `first` (7,) by a straight line to the way's (K, 7) nearest free pose, then down it."""
    for i in range(1, len(way)):
        if edge_is_free(collision, first, way[i], config.rrt.resolution_rad):
            return np.concatenate((first[None], way[i::-1]))
    return None


def _shortest(paths: Iterator[Array | None]) -> Array | None:
    return min((path for path in paths if path is not None), key=path_rad, default=None)
