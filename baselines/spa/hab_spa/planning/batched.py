"""RRT-Connect and shortcuts of the planner ``batched``: whole edges are checked at a time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hab_spa.planning import rrt
from hab_spa.planning.batch import search_kernel
from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.rrt import Limit, RrtConfig
from hab_spa.shapes import Array

MOST_NODES = 4_000
MOST_VERTICES = 400


def connect(
    collision: ArmCollision, start: Array, goal: Array, seed: int, limit: Limit, config: RrtConfig
) -> Array | None:
    """As `rrt.connect`; where coal has to confirm an end, OMPL searches."""
    if not collision.are_clear(np.stack((start, goal))):
        return rrt.connect(collision, start, goal, seed, limit, config)
    trees = np.empty((2, MOST_NODES, len(start)))
    parents = np.zeros((2, MOST_NODES), dtype=np.int64)
    trees[0, 0], trees[1, 0] = start, goal
    rng = np.random.default_rng(seed)
    # Drawn here, as numba's generator is seeded apart from numpy's.
    samples = rng.uniform(*collision.limits_rad, (MOST_NODES, len(start)))
    checks = np.zeros(1, dtype=np.int64)
    met = search_kernel().connect(
        collision.shapes,
        trees,
        parents,
        samples,
        config.range_rad,
        config.resolution_rad,
        limit.checks,
        checks,
    )
    collision.checks += int(checks[0])
    if met[0] < 0:
        return None
    ways = [
        _way(tree, parent, node) for tree, parent, node in zip(trees, parents, met, strict=True)
    ]
    # The nodes where the trees meet are equal.
    return np.concatenate((ways[0], ways[1][-2::-1]))


def first_free(
    collision: ArmCollision, start: Array, goals: Array, resolution_rad: float
) -> int | None:
    """As `rrt.first_free`, but for edges that coal has to confirm."""
    checks = np.zeros(1, dtype=np.int64)
    found = search_kernel().first_free(
        collision.shapes, start[None], np.ascontiguousarray(goals), resolution_rad, checks
    )
    collision.checks += int(checks[0])
    return None if found < 0 else found


def _way(tree: Array, parent: NDArray[np.int64], node: int) -> Array:
    """Returns the poses (K, J) from the root of a tree to a node."""
    numbers = [node]
    while numbers[-1]:
        numbers.append(int(parent[numbers[-1]]))
    return tree[numbers[::-1]]


def shorten(
    collision: ArmCollision, path: Array, seed: int, deadline_s: float, config: RrtConfig
) -> Array:
    """As `rrt.shorten`; it takes milliseconds, so that the deadline does not matter."""
    # A cut may add vertices before it removes others.
    if len(path) > MOST_VERTICES // 2:
        return rrt.shorten(collision, path, seed, deadline_s, config)
    room, checks = np.empty((MOST_VERTICES, path.shape[1])), np.zeros(1, dtype=np.int64)
    room[: len(path)] = path
    draws = np.random.default_rng(seed).uniform(size=(config.passes * config.shortcuts, 3))
    size = search_kernel().shorten(
        collision.shapes,
        room,
        len(path),
        draws,
        config.passes,
        config.gain,
        config.resolution_rad,
        checks,
    )
    collision.checks += int(checks[0])
    return room[:size].copy()
