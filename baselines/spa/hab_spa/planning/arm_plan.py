"""Motion plans of the arm between an open and a tight end (S App. D).

Each pair of ends is tried in three ways, the cheapest first: a straight line in joint space;
the gripper drawn straight out of the tight end, then on by a straight line or by RRTConnect;
RRTConnect from end to end. Runs of RRTConnect are short and start again with new random
numbers, because their running time has a long tail; ends that the gripper can be drawn out of the
farthest come first, for the others are hard to get out of.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import count, pairwise, product

import numpy as np

from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.escape import EscapeConfig, retreats
from hab_spa.planning.ik import BatchArm
from hab_spa.planning.rrt import Limit, RrtConfig, connect, edge_is_free, path_is_free, shorten
from hab_spa.results import Failure, PathResult
from hab_spa.shapes import Array


@dataclass(frozen=True, kw_only=True)
class PlanConfig:
    """The motion planner's numbers.

    Attributes:
        time_limit_s: All attempts together take at most this long (S App. D).
        margins_m: Wanted clearances of the attempts, one after the other.
        range_rad: Step of the first run of RRTConnect (S App. D) ...
        restart_range_rad: ... and of those after it, whose steps are tested just as finely. In a
            fridge, steps of 0.1 rad need 10 to 30 times as many tests.
        first_checks: The first runs of RRTConnect give up after this many collision checks;
            the next round of runs after twice as many, and so on.
        good_rad: A path this short (largest joint, summed over its edges) is not improved on.
        improve_checks: A longer one is, with so many checks if it is twice as long, and in
            proportion to what it is too long.
        most_checks: After so many, no further attempt is made.
        roomy_ends: From so many ends RRTConnect runs in turn.
        verify_rad: A path found is tested once more at this resolution, without clearance.
        rrt: Numbers of one run; its step is replaced by the two above.
        retreat: Numbers of drawing the gripper out.
    """

    time_limit_s: float = 30.0
    margins_m: tuple[float, ...] = (0.02, 0.01, 0.003)
    range_rad: float = 0.1
    restart_range_rad: float = 1.0
    first_checks: int = 2_000
    good_rad: float = 2.5
    improve_checks: int = 4_000
    most_checks: int = 30_000
    roomy_ends: int = 3
    verify_rad: float = 0.015
    rrt: RrtConfig = field(default_factory=RrtConfig)
    retreat: EscapeConfig = field(default_factory=EscapeConfig)


@dataclass(frozen=True, kw_only=True, eq=False)
class Ends:
    """Arm poses (7,) [rad] to connect; the tight one is where obstacles are near."""

    open: Array
    tight: Array


@dataclass(frozen=True, eq=False)
class _Attempt:
    """One way to connect; a `range_rad` of 0 stands for straight lines only."""

    margin_m: float
    pair: int
    retreats: bool
    range_rad: float
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

    Raises:
        ValueError: `ends` is empty.
    """
    if not ends:
        raise ValueError("plan_path needs at least one pair of ends.")
    return _Search(collision, arm, ends, config, touch_m).run(seed)


def path_rad(path: Array) -> float:
    """Length of a path (K, 7): the largest joint displacement of each edge, summed."""
    return float(np.abs(np.diff(path, axis=0)).max(axis=1).sum())


class _Search:
    """The attempts of one call of `plan_path`."""

    def __init__(
        self,
        collision: ArmCollision,
        arm: BatchArm,
        ends: Sequence[Ends],
        config: PlanConfig,
        touch_m: float,
    ) -> None:
        self._collision, self._arm, self._ends = collision, arm, ends
        self._config, self._touch_m = config, touch_m
        self._deadline_s = time.perf_counter() + config.time_limit_s
        self._ways: dict[tuple[float, int], list[Array]] = {}
        self._close: dict[int, dict[int, float]] = {}

    def run(self, seed: int) -> PathResult:
        """Makes attempts until one succeeds, and some more when its path is long."""
        began, checks_before, before = time.perf_counter(), self._collision.checks, 0
        best, enough = None, self._config.most_checks
        for i, attempt in enumerate(self._attempts()):
            spent = self._collision.checks - checks_before
            if spent >= enough or time.perf_counter() >= self._deadline_s:
                break
            path = self._attempt(attempt, seed + i)
            if path is None or (best is not None and path_rad(path) >= path_rad(best)):
                continue
            if best is None:
                before = self._collision.checks - checks_before
            too_long = path_rad(path) / self._config.good_rad - 1.0
            best, enough = path, before + int(too_long * self._config.improve_checks)
        return PathResult(
            path=best,
            failure=Failure.MOTION_PLAN if best is None else None,
            seconds=time.perf_counter() - began,
            checks=self._collision.checks - checks_before,
        )

    def _attempts(self) -> Iterator[_Attempt]:
        """Straight ways, one run with the paper's step, then ever longer runs without end."""
        config, margins_m = self._config, self._config.margins_m
        pairs = range(len(self._ends))
        for margin_m, retreats_, pair in product(margins_m, (False, True), pairs):
            yield _Attempt(margin_m, pair, retreats_, range_rad=0.0, checks=0)
        yield _Attempt(margins_m[0], 0, False, config.range_rad, config.first_checks)
        for power in count():
            checks = config.first_checks * 2**power
            for margin_m in margins_m:
                roomy = sorted(pairs, key=lambda pair, m=margin_m: -self._way_out_steps(m, pair))
                for pair in roomy[: config.roomy_ends]:
                    yield _Attempt(margin_m, pair, True, config.restart_range_rad, checks)
            pair = power % len(pairs)
            yield _Attempt(margins_m[-1], pair, False, config.restart_range_rad, checks)

    def _way_out_steps(self, margin_m: float, pair: int) -> int:
        """How far the gripper can be drawn out of an end; all were tried at all margins before."""
        return max((len(way) for way in self._ways.get((margin_m, pair), [])), default=0)

    def _attempt(self, attempt: _Attempt, seed: int) -> Array | None:
        ends, config = self._ends[attempt.pair], self._config.rrt
        self._keep(attempt.margin_m, attempt.pair)
        if attempt.range_rad == 0.0:
            path = self._straight(attempt, ends)
        else:
            path = self._connect(attempt, ends, seed)
        if path is not None and len(path) > 2:
            path = shorten(self._collision, path, seed, self._deadline_s, config)
        return path if path is not None and self._stands(path, attempt.pair) else None

    def _keep(self, margin_m: float, pair: int) -> None:
        """Asks for a margin, less where an end has shapes closer together."""
        if pair not in self._close:
            self._collision.set_margin(max(self._config.margins_m))
            ends, close = self._ends[pair], {}
            for contact in (
                c for q in (ends.open, ends.tight) for c in self._collision.contacts(q)
            ):
                gap_m = contact.distance_m - self._touch_m
                close[contact.pair] = min(gap_m, close.get(contact.pair, gap_m))
            self._close[pair] = close
        self._collision.set_margin(margin_m, self._close[pair])

    def _stands(self, path: Array, pair: int) -> bool:
        """Whether nothing touches along the path between the points that were tested."""
        self._keep(0.0, pair)
        return path_is_free(self._collision, path, self._config.verify_rad)

    def _straight(self, attempt: _Attempt, ends: Ends) -> Array | None:
        """A straight line, or one to a retreat's first free pose and then down the retreat."""
        resolution_rad = self._config.rrt.resolution_rad
        if not attempt.retreats:
            free = edge_is_free(self._collision, ends.open, ends.tight, resolution_rad)
            return np.stack((ends.open, ends.tight)) if free else None
        paths = []
        for way in self._retreats(attempt):
            for i in range(1, len(way)):
                if edge_is_free(self._collision, ends.open, way[i], resolution_rad):
                    paths.append(np.concatenate((ends.open[None], way[i::-1])))
                    break
        return min(paths, key=path_rad, default=None)

    def _connect(self, attempt: _Attempt, ends: Ends, seed: int) -> Array | None:
        """RRTConnect to the tight end, or to the end of the longest retreat from it."""
        limit = Limit(checks=attempt.checks, deadline_s=self._deadline_s)
        config = replace(self._config.rrt, range_rad=attempt.range_rad)
        if not attempt.retreats:
            return connect(self._collision, ends.open, ends.tight, seed, limit, config)
        ways = self._retreats(attempt)
        if not ways:
            return None
        way = max(ways, key=len)
        path = connect(self._collision, ends.open, way[-1], seed, limit, config)
        return None if path is None else np.concatenate((path, way[-2::-1]))

    def _retreats(self, attempt: _Attempt) -> list[Array]:
        """The ways out of the tight end: at larger margins, as far as they keep them."""
        least_m = min(self._config.margins_m)
        if (least_m, attempt.pair) not in self._ways:
            self._keep(least_m, attempt.pair)
            tight = self._ends[attempt.pair].tight
            ways = retreats(self._collision, self._arm, tight, self._config.retreat)
            self._ways[least_m, attempt.pair] = ways
            self._keep(attempt.margin_m, attempt.pair)
        key = attempt.margin_m, attempt.pair
        if key not in self._ways:
            longest = [self._as_far_as_free(way) for way in self._ways[least_m, attempt.pair]]
            self._ways[key] = [way for way in longest if len(way) > 1]
        return self._ways[key]

    def _as_far_as_free(self, way: Array) -> Array:
        for i, (first, second) in enumerate(pairwise(way)):
            if not edge_is_free(
                self._collision, first, second, self._config.retreat.resolution_rad
            ):
                return way[: i + 1]
        return way
