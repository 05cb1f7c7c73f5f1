"""Motion planning of the arm: RRTConnect in joint space, through OMPL (S App. D)."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from hab_spa.collision import ArmCollision
from hab_spa.ik import LOWER_RAD, UPPER_RAD
from hab_spa.results import Failure, PathResult
from hab_spa.shapes import Array

DIMENSION = 7


@dataclass(frozen=True, kw_only=True)
class PlanConfig:
    """The motion planner's numbers.

    Attributes:
        range_rad: Step of RRTConnect (S App. D).
        time_limit_s: All attempts together take at most this long (S App. D).
        resolution_rad: Edges are tested at points at most this far apart (Euclidean).
        margins_m: Wanted clearances of the attempts, one after the other.
        attempt_checks: An attempt, except the last one, gives up after this many tests.
        shortcuts: Attempts to shorten the path, in each of the two passes.
    """

    range_rad: float = 0.1
    time_limit_s: float = 30.0
    resolution_rad: float = 0.05
    margins_m: tuple[float, ...] = (0.02, 0.01, 0.003)
    attempt_checks: int = 30_000
    shortcuts: int = 100


def plan_path(
    collision: ArmCollision,
    start: Array,
    goals: Array,
    seed: int,
    config: PlanConfig,
    touch_m: float = 0.001,
) -> PathResult:
    """Plans from an arm pose (7,) to one of the goals (G, 7), the first where possible.

    Pairs of shapes that the start or the goal brings closer than the margin may stay that
    close along the path; all other pairs keep the margin.

    Args:
        collision: Tells which arm poses are free; its margins are changed.
        start: (7,) [rad].
        goals: (G, 7) [rad], best first.
        seed: Same arguments and seed, same path, unless the time limit strikes.
        config: The planner's numbers.
        touch_m: Pairs that are too close at the start may come this much closer still.
    """
    began, checks_before = time.perf_counter(), collision.checks
    attempts = [(margin_m, goal) for margin_m in config.margins_m for goal in goals]
    path = None
    for i, (margin_m, goal) in enumerate(attempts):
        left_s = config.time_limit_s - (time.perf_counter() - began)
        if left_s <= 0.0:
            break
        limit = None if i == len(attempts) - 1 else config.attempt_checks
        collision.set_margin(margin_m)
        collision.relax(start, touch_m)
        collision.relax(goal)
        path = _connect(collision, start, goal, seed + i, left_s, limit, config)
        if path is not None:
            break
    return PathResult(
        path=path,
        failure=Failure.MOTION_PLAN if path is None else None,
        seconds=time.perf_counter() - began,
        checks=collision.checks - checks_before,
    )


def edge_is_free(
    collision: ArmCollision, first: Array, second: Array, resolution_rad: float
) -> bool:
    """Whether the straight line between two arm poses (7,) is free, ends included."""
    count = max(1, int(np.ceil(np.linalg.norm(second - first) / resolution_rad)))
    return all(collision.is_free(first + (second - first) * (i / count)) for i in range(count + 1))


def _space_information(
    is_free: Callable[[Array], bool], resolution_rad: float
) -> ob.SpaceInformation:
    bounds = ob.RealVectorBounds(DIMENSION)
    for i in range(DIMENSION):
        bounds.setLow(i, float(LOWER_RAD[i]))
        bounds.setHigh(i, float(UPPER_RAD[i]))
    space = ob.RealVectorStateSpace(DIMENSION)
    space.setBounds(bounds)
    information = ob.SpaceInformation(space)
    pose = np.empty(DIMENSION)

    def is_valid(state: Any) -> bool:
        for i in range(DIMENSION):
            pose[i] = state[i]
        return is_free(pose)

    information.setStateValidityChecker(is_valid)
    information.setStateValidityCheckingResolution(resolution_rad / space.getMaximumExtent())
    information.setup()
    return information


def _state(information: ob.SpaceInformation, pose: Array) -> Any:
    # The stubs name the base class, which has no items; the space's own states have.
    state: Any = information.allocState()
    for i, value in enumerate(np.clip(pose, LOWER_RAD, UPPER_RAD)):
        state[i] = float(value)
    return state


def _connect(
    collision: ArmCollision,
    start: Array,
    goal: Array,
    seed: int,
    seconds: float,
    checks: int | None,
    config: PlanConfig,
) -> Array | None:
    """One run of RRTConnect, limited in seconds and, if given, in collision checks."""
    if edge_is_free(collision, start, goal, config.resolution_rad):
        return np.stack((start, goal))
    # OMPL complains that earlier generators keep their seeds; those made below get the new one.
    ou.setLogLevel(ou.LogLevel.LOG_NONE)
    ou.RNG.setSeed(seed % (2**31 - 1) + 1)
    information = _space_information(collision.is_free, config.resolution_rad)
    problem = ob.ProblemDefinition(information)
    problem.setStartAndGoalStates(_state(information, start), _state(information, goal))
    planner = og.RRTConnect(information)
    planner.setRange(config.range_rad)
    planner.setProblemDefinition(problem)
    planner.setup()
    deadline = time.perf_counter() + seconds
    last_check = np.inf if checks is None else collision.checks + checks

    def gives_up() -> bool:
        return collision.checks >= last_check or time.perf_counter() >= deadline

    planner.solve(ob.PlannerTerminationCondition(gives_up))
    if not problem.hasExactSolution():
        return None
    path: Any = problem.getSolutionPath()
    if time.perf_counter() < deadline:
        _shorten(information, path, config)
    states = [[state[i] for i in range(DIMENSION)] for state in path.getStates()]
    return np.array([start, *states[1:-1], goal])


def _shorten(information: ob.SpaceInformation, path: og.PathGeometric, config: PlanConfig) -> None:
    """Shortens the path in place; the counts, not the clock, end it."""
    simplifier = og.PathSimplifier(information)
    for _ in range(2):
        simplifier.reduceVertices(path, config.shortcuts, config.shortcuts)
        simplifier.partialShortcutPath(path, config.shortcuts, config.shortcuts)
    simplifier.collapseCloseVertices(path)
