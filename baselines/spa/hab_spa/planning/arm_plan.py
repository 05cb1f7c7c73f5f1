"""Motion planning of the arm between an open and a tight end (S App. D).

Each pair of ends is tried by three methods, the cheapest first: a straight edge in joint space; a
straight-line retreat of the gripper from the tight end, continued by a straight edge or by
RRT-Connect; RRT-Connect between the ends. Runs of RRT-Connect are short and restarted with new
random numbers, because their running time has a long tail. Ends with long retreats come first, as
the others are hard to leave.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise, product

import numpy as np
from hab_plans.motion import Failure
from hab_plans.protocols import PathResult

from hab_spa.planning import batched, rrt
from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.escape import EscapeConfig, retreats
from hab_spa.planning.ik import BatchArm, CompiledArm
from hab_spa.planning.rrt import Limit, RrtConfig, edge_is_free, path_is_free
from hab_spa.shapes import Array
from hab_tasks.robots.spec import RobotSpec

LIMIT_SLACK_RAD = 1e-6


@dataclass(frozen=True, kw_only=True)
class PlanConfig:
    """Parameters of the motion planner.

    Attributes:
        time_limit_s: Time limit of all attempts (S App. D).
        margins_m: Clearances, tried in this order.
        range_rad: Range of the first run of RRT-Connect (S App. D) ...
        restart_range_rad: ... and of the restarts, with the same resolution of collision checks.
            In a fridge, a range of 0.1 rad needs 10 to 30 times as many checks.
        first_checks: Maximum collision checks of the first runs of RRT-Connect; doubled in each
            further round.
        good_rad: Maximum length (largest joint, summed over edges) of a path that is not improved.
        improve_checks: Collision checks for improving a path of twice this length; proportional
            to the excess length.
        most_checks: Maximum collision checks in total.
        roomy_ends: Number of ends per margin and round from which RRT-Connect runs.
        verify_rad: Resolution of the final check of a path, without clearance.
        rrt: Parameters of one run; its range is replaced by the two above.
        retreat: Parameters of retreats.
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
    """Arm poses (J,) [rad] to connect; the tight end is near obstacles."""

    open: Array
    tight: Array


@dataclass(frozen=True, eq=False)
class _Attempt:
    """One attempt; a `range_rad` of 0 stands for straight edges only."""

    margin_m: float
    pair: int
    retreats: bool
    range_rad: float
    checks: int


class OmplPlanner:
    """Plans by straight edges, retreats and OMPL's RRT-Connect.

    Attributes:
        kinematics: Class of the arm's kinematics.
        connect, shorten: Run RRT-Connect and simplify its path; see `rrt`.
        first_free: Finds a pose that a straight edge reaches.
        effort: Multiple of the limits' maximum number of checks.
    """

    effort = 1
    kinematics: type[BatchArm] = BatchArm

    connect = staticmethod(rrt.connect)
    shorten = staticmethod(rrt.shorten)
    first_free = staticmethod(rrt.first_free)

    def plan(
        self,
        start: Array,
        goals: Array,
        world: ArmCollision,
        *,
        seed: int,
        limits: PlanConfig,
        touch_m: float = 0.001,
        backwards: bool = False,
    ) -> PathResult:
        """See `MotionPlanner`; the path is reproducible unless the time limit is reached.

        Pairs of shapes that are closer than the margin at an end may be as close along the path;
        all other pairs keep the margin.

        Raises:
            ValueError: There are no goals, or one is not finite or beyond the limits.
        """
        if not len(goals):
            raise ValueError("A motion planner needs at least one goal.")
        lower, upper = world.limits_rad
        # Samplers clip to the limits, so that a goal may lie on one.
        within = (goals > lower - LIMIT_SLACK_RAD) & (goals < upper + LIMIT_SLACK_RAD)
        if not within.all():
            goal, joint = np.argwhere(~within)[0]
            name = world.robot.arm_joints[joint]
            raise ValueError(
                f"goal {goal}: joint {name} at {goals[goal, joint]:.3f} rad is "
                f"beyond {lower[joint]:.3f} to {upper[joint]:.3f} rad."
            )
        if backwards:
            # Leaving a tight place is reaching it, backwards: the search always ends there.
            ends = [Ends(open=goal, tight=start) for goal in goals]
        else:
            ends = [Ends(open=start, tight=goal) for goal in goals]
        limits = replace(limits, most_checks=self.effort * limits.most_checks)
        arm = _arm(self.kinematics, world.robot)
        result = _Search(self, world, arm, ends, limits, touch_m).run(seed)
        if backwards and result.path is not None:
            result = replace(result, path=result.path[::-1])
        return result


class BatchedPlanner(OmplPlanner):
    """As `OmplPlanner`, with compiled searches and kinematics; its checks are cheaper."""

    effort = 3
    kinematics = CompiledArm

    connect = staticmethod(batched.connect)
    shorten = staticmethod(batched.shorten)
    first_free = staticmethod(batched.first_free)


PLANNERS = {"ompl": OmplPlanner, "batched": BatchedPlanner}
"""Option ``planner``."""


@cache
def _arm(kinematics: type[BatchArm], robot: RobotSpec) -> BatchArm:
    """Returns the kinematics of a robot, made once, as every skill plans several times."""
    return kinematics(robot)


def path_rad(path: Array) -> float:
    """Returns the length of a path (K, J): the largest joint displacement, summed over edges."""
    return float(np.abs(np.diff(path, axis=0)).max(axis=1).sum())


class _Search:
    """The attempts of one call of `OmplPlanner.plan`."""

    def __init__(
        self,
        planner: OmplPlanner,
        collision: ArmCollision,
        arm: BatchArm,
        ends: Sequence[Ends],
        config: PlanConfig,
        touch_m: float,
    ) -> None:
        self._planner, self._collision, self._arm, self._ends = planner, collision, arm, ends
        self._config, self._touch_m = config, touch_m
        self._deadline_s = time.perf_counter() + config.time_limit_s
        self._retreat_paths: dict[tuple[float, int], list[Array]] = {}
        self._close: dict[int, dict[int, float]] = {}
        self._simplify_s = 0.0

    def run(self, seed: int) -> PathResult:
        """Runs attempts until one succeeds, and more if its path is long."""
        began, checks_before, before = time.perf_counter(), self._collision.checks, 0
        best, enough, stopped_by = None, self._config.most_checks, "checks"
        for i, attempt in enumerate(self._attempts()):
            spent = self._collision.checks - checks_before
            late = time.perf_counter() >= self._deadline_s
            if spent >= enough or late:
                stopped_by = "time" if late else "checks"
                break
            # A seed by the attempt's number, so that none depends on the draws of those before it.
            path = self._attempt(attempt, seed + i)
            if path is None or (best is not None and path_rad(path) >= path_rad(best)):
                continue
            # From the first path on, more checks are spent in proportion to what there is to gain.
            if best is None:
                before = self._collision.checks - checks_before
            too_long = path_rad(path) / self._config.good_rad - 1.0
            best, enough = path, before + int(too_long * self._config.improve_checks)
        return PathResult(
            path=best,
            failure=Failure.MOTION_PLAN if best is None else None,
            seconds=time.perf_counter() - began,
            checks=self._collision.checks - checks_before,
            simplify_s=self._simplify_s,
            stopped_by=stopped_by if best is None else None,
        )

    def _attempts(self) -> Iterator[_Attempt]:
        """Yields straight edges, one run with the paper's range, then ever longer runs."""
        config, margins_m = self._config, self._config.margins_m
        pairs = range(len(self._ends))
        # At all margins before any search, which costs far more.
        for margin_m, retreats_, pair in product(margins_m, (False, True), pairs):
            yield _Attempt(margin_m, pair, retreats_, range_rad=0.0, checks=0)
        # Once only, as its small range rarely pays in tight places (`PlanConfig`).
        yield _Attempt(margins_m[0], 0, False, config.range_rad, config.first_checks)
        # Not without end, as attempts from a blocked end spend no checks.
        for power in range(1 + (config.most_checks // config.first_checks).bit_length()):
            # A hard problem gets a long run, but only after short ones have failed.
            checks = config.first_checks * 2**power
            for margin_m in margins_m:
                roomy = sorted(pairs, key=lambda pair, m=margin_m: -self._retreat_steps(m, pair))
                for pair in roomy[: config.roomy_ends]:
                    yield _Attempt(margin_m, pair, True, config.restart_range_rad, checks)
            # Without a retreat too, one pair a round: where the hand backs out need not be the way.
            pair = power % len(pairs)
            yield _Attempt(margins_m[-1], pair, False, config.restart_range_rad, checks)

    def _retreat_steps(self, margin_m: float, pair: int) -> int:
        """Returns the length of the longest retreat from an end; all have been computed before."""
        return max(
            (len(retreat) for retreat in self._retreat_paths.get((margin_m, pair), [])), default=0
        )

    def _attempt(self, attempt: _Attempt, seed: int) -> Array | None:
        ends, config = self._ends[attempt.pair], self._config.rrt
        self._keep(attempt.margin_m, attempt.pair)
        if attempt.range_rad == 0.0:
            path = self._straight(attempt, ends)
        else:
            path = self._connect(attempt, ends, seed)
        if path is not None and len(path) > 2:
            # Shortcuts are checked coarsely, hence the finer check of the result.
            began = time.perf_counter()
            path = self._planner.shorten(self._collision, path, seed, self._deadline_s, config)
            self._simplify_s += time.perf_counter() - began
        return path if path is not None and self._stands(path, attempt.pair) else None

    def _keep(self, margin_m: float, pair: int) -> None:
        """Sets the margin, reduced for pairs that are closer at an end."""
        if pair not in self._close:
            # Contacts are told within the margin only, so the largest one finds all close pairs.
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
        """Whether a path is free of contacts at a finer resolution."""
        self._keep(0.0, pair)
        return path_is_free(self._collision, path, self._config.verify_rad)

    def _straight(self, attempt: _Attempt, ends: Ends) -> Array | None:
        """Tries a straight edge, or one to the first free pose of a retreat."""
        resolution_rad = self._config.rrt.resolution_rad
        if not attempt.retreats:
            free = edge_is_free(self._collision, ends.open, ends.tight, resolution_rad)
            return np.stack((ends.open, ends.tight)) if free else None
        paths = []
        for retreat in self._retreats(attempt):
            i = self._planner.first_free(self._collision, ends.open, retreat[1:], resolution_rad)
            if i is not None:
                paths.append(np.concatenate((ends.open[None], retreat[i + 1 :: -1])))
        # All directions are tried: straight edges are cheap, and a short path needs no improving.
        return min(paths, key=path_rad, default=None)

    def _connect(self, attempt: _Attempt, ends: Ends, seed: int) -> Array | None:
        """Runs RRT-Connect to the tight end, or to the end of its longest retreat."""
        limit = Limit(checks=attempt.checks, deadline_s=self._deadline_s)
        config = replace(self._config.rrt, range_rad=attempt.range_rad)
        if not attempt.retreats:
            return self._planner.connect(
                self._collision, ends.open, ends.tight, seed, limit, config
            )
        retreat_paths = self._retreats(attempt)
        if not retreat_paths:
            return None
        # The longest leads farthest out of the tight place.
        retreat = max(retreat_paths, key=len)
        path = self._planner.connect(self._collision, ends.open, retreat[-1], seed, limit, config)
        return None if path is None else np.concatenate((path, retreat[-2::-1]))

    def _retreats(self, attempt: _Attempt) -> list[Array]:
        """Returns the retreats from the tight end; at larger margins, as far as they keep them."""
        least_m = min(self._config.margins_m)
        # Inverse kinematics runs once, at the smallest margin; larger ones cut its lines short.
        if (least_m, attempt.pair) not in self._retreat_paths:
            self._keep(least_m, attempt.pair)
            tight = self._ends[attempt.pair].tight
            retreat_paths = retreats(self._collision, self._arm, tight, self._config.retreat)
            self._retreat_paths[least_m, attempt.pair] = retreat_paths
            self._keep(attempt.margin_m, attempt.pair)
        key = attempt.margin_m, attempt.pair
        if key not in self._retreat_paths:
            longest = [
                self._as_far_as_free(retreat)
                for retreat in self._retreat_paths[least_m, attempt.pair]
            ]
            self._retreat_paths[key] = [retreat for retreat in longest if len(retreat) > 1]
        return self._retreat_paths[key]

    def _as_far_as_free(self, retreat: Array) -> Array:
        for i, (first, second) in enumerate(pairwise(retreat)):
            if not edge_is_free(
                self._collision, first, second, self._config.retreat.resolution_rad
            ):
                return retreat[: i + 1]
        return retreat
