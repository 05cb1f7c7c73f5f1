"""RRT-Connect and path simplification in the arm's joint space, by OMPL (S App. D)."""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from hab_spa.planning.collision import ArmCollision
from hab_spa.shapes import Array


@dataclass(frozen=True, kw_only=True)
class RrtConfig:
    """Parameters of one run.

    Attributes:
        range_rad: Range (step size) of RRT-Connect (S App. D).
        resolution_rad: Resolution of collision checks along edges (Euclidean).
        shortcuts: Shortcut attempts per pass of the simplifier.
        passes: Maximum passes of the simplifier.
        gain: The simplifier stops when a pass shortens the path by less than this fraction.
    """

    range_rad: float = 0.1
    resolution_rad: float = 0.05
    shortcuts: int = 60
    passes: int = 6
    gain: float = 0.02


@dataclass(frozen=True, kw_only=True)
class Limit:
    """Termination condition of a run.

    Attributes:
        checks: Maximum number of collision checks. This limit, not the clock, ends most runs, so
            that results depend only on the seed.
        deadline_s: Value of `time.perf_counter` at which to stop.
    """

    checks: int
    deadline_s: float


def edge_is_free(
    collision: ArmCollision, first: Array, second: Array, resolution_rad: float
) -> bool:
    """Whether the straight edge between two arm poses (J,) is free, including its ends."""
    poses = _along(first, second, resolution_rad)
    return collision.free_until(poses) == len(poses)


def first_free(
    collision: ArmCollision, start: Array, goals: Array, resolution_rad: float
) -> int | None:
    """Returns the first of the goals (G, J) to which the straight edge from an arm pose is free."""
    edges = (edge_is_free(collision, start, goal, resolution_rad) for goal in goals)
    return next((number for number, free in enumerate(edges) if free), None)


def path_is_free(collision: ArmCollision, path: Array, resolution_rad: float) -> bool:
    """Whether all edges of a path (K, J) are free."""
    edges = [_along(first, second, resolution_rad) for first, second in pairwise(path)]
    poses = np.concatenate((path[:0], *edges))
    return collision.free_until(poses) == len(poses)


def _along(first: Array, second: Array, resolution_rad: float) -> Array:
    """Returns the arm poses (K, J) to check along an edge, including its ends."""
    count = max(1, int(np.ceil(np.linalg.norm(second - first) / resolution_rad)))
    return first + (second - first) * (np.arange(count + 1) / count)[:, None]


def connect(
    collision: ArmCollision, start: Array, goal: Array, seed: int, limit: Limit, config: RrtConfig
) -> Array | None:
    """Runs RRT-Connect once from `start` (J,) to `goal` (J,); returns a path (K, J) or None."""
    last_check = collision.checks + limit.checks
    information = _space_information(collision, seed, config)
    problem = ob.ProblemDefinition(information)
    ends = (_state(information, pose, collision.limits_rad) for pose in (start, goal))
    problem.setStartAndGoalStates(*ends)
    planner = og.RRTConnect(information)
    planner.setRange(config.range_rad)
    planner.setProblemDefinition(problem)
    planner.setup()

    def gives_up() -> bool:
        return collision.checks >= last_check or time.perf_counter() >= limit.deadline_s

    planner.solve(ob.PlannerTerminationCondition(gives_up))
    if not problem.hasExactSolution():
        return None
    path: Any = problem.getSolutionPath()
    # States are clipped to the limits; the ends have to be the poses asked for.
    return np.array([start, *_poses(path, len(start))[1:-1], goal])


def shorten(
    collision: ArmCollision, path: Array, seed: int, deadline_s: float, config: RrtConfig
) -> Array:
    """Shortens a free path (K, J) with OMPL's simplifier; ends are kept, the result is free."""
    information = _space_information(collision, seed, config)
    states = [_state(information, pose, collision.limits_rad) for pose in path]
    simplified = og.PathGeometric(information, states)
    simplifier = og.PathSimplifier(information)
    length = simplified.length()
    # Passes instead of OMPL's own time limit, on which results would depend.
    for _ in range(config.passes):
        if time.perf_counter() >= deadline_s:
            break
        simplifier.reduceVertices(simplified, config.shortcuts, config.shortcuts)
        simplifier.partialShortcutPath(simplified, config.shortcuts, config.shortcuts)
        before, length = length, simplified.length()
        if length > (1.0 - config.gain) * before:
            break
    return np.array([path[0], *_poses(simplified, path.shape[1])[1:-1], path[-1]])


def _poses(path: Any, joints: int) -> list[list[float]]:
    return [[state[i] for i in range(joints)] for state in path.getStates()]


def _space_information(
    collision: ArmCollision, seed: int, config: RrtConfig
) -> ob.SpaceInformation:
    """Returns the joint space with a validity checker, and seeds OMPL's random numbers."""
    # OMPL warns that existing generators keep their seeds; only new ones are used here.
    ou.setLogLevel(ou.LogLevel.LOG_NONE)
    # OMPL takes 32 bits, and refuses 0.
    ou.RNG.setSeed(seed % (2**31 - 1) + 1)
    joints = len(collision.limits_rad[0])
    bounds = ob.RealVectorBounds(joints)
    for i, (low, high) in enumerate(zip(*collision.limits_rad, strict=True)):
        bounds.setLow(i, float(low))
        bounds.setHigh(i, float(high))
    space = ob.RealVectorStateSpace(joints)
    space.setBounds(bounds)
    information = ob.SpaceInformation(space)
    pose = np.empty(joints)

    def is_valid(state: Any) -> bool:
        for i in range(joints):
            pose[i] = state[i]
        return bool(collision.is_free(pose))  # OMPL rejects numpy's bool

    information.setStateValidityChecker(is_valid)
    # OMPL takes the resolution as a share of the space's diagonal.
    information.setStateValidityCheckingResolution(config.resolution_rad / space.getMaximumExtent())
    information.setup()
    return information


def _state(information: ob.SpaceInformation, pose: Array, limits_rad: tuple[Array, Array]) -> Any:
    # The stubs declare the base class, which has no items; states of a vector space do.
    state: Any = information.allocState()
    for i, value in enumerate(np.clip(pose, *limits_rad)):
        state[i] = float(value)
    return state
