"""Validation of layouts: each must load, settle and be usable by the robot."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from hab_authoring.layouts.checks import check_layout
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.errors import HabError
from hab_tasks.geometry import Array
from hab_tasks.io.pool import WorkerPool, in_order
from hab_tasks.world.scenes.floor import body_points
from hab_tasks.world.scenes.habitat.dataset import SceneDataset
from hab_tasks.world.scenes.habitat.load import load_scene

MOVED_M = 0.01
WATCH_S = 2.0
FALLEN_M = -0.2
"""Bodies entirely below this height have fallen out of the room."""

_BEAT_S = 0.25
"""Check interval of `PlacementSandbox.settle`, which ends when everything sleeps."""


def layout_faults(dataset: SceneDataset, scene_id: str) -> tuple[str, ...]:
    """Returns the faults of a layout, one line each: it must load, settle and be usable."""
    try:
        spec = load_scene(dataset, scene_id)
        report = check_layout(dataset, scene_id)
    except HabError as error:
        return (f"does not load: {error}",)
    return (*unrest(PlacementSandbox(spec, {})), *report.reasons)


def unrest(sandbox: PlacementSandbox) -> list[str]:
    """Returns bodies that fell out of the room, or still move after the layout has settled.

    The layout starts like an episode: settled, at rest, doors and drawers closed. No corner of any
    shape may then move by more than `MOVED_M` in `WATCH_S`.
    """
    sandbox.show(())
    before = _corners(sandbox)
    for _ in range(round(WATCH_S / _BEAT_S)):
        sandbox.settle(_BEAT_S)
    after = _corners(sandbox)
    faults = []
    for name, points in before.items():
        moved_m = float(np.linalg.norm(after[name] - points, axis=0).max())
        top_m = float(points[2].max())
        if top_m < FALLEN_M:
            faults.append(f"fallen: {name} is {-top_m:.2f} m under the floor")
        elif moved_m > MOVED_M:
            faults.append(f"unstable: {name} moves by {moved_m:.3f} m in {WATCH_S:g} s")
    return faults


def check_layouts(
    dataset: SceneDataset, scene_ids: Iterable[str], workers: int
) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yields every scene id with its faults, in order.

    Args:
        dataset: The scene dataset.
        scene_ids: Layouts to check.
        workers: Number of processes; with 1, checks run in this process.
    """
    scenes = list(scene_ids)
    if workers == 1:
        yield from ((scene_id, layout_faults(dataset, scene_id)) for scene_id in scenes)
        return
    with WorkerPool(workers, _quiet_check, (dataset.root,)) as pool:
        yield from zip(scenes, in_order(pool.run(scenes)), strict=True)


def _quiet_check(root: Path) -> Callable[[str], tuple[str, ...]]:
    logging.disable(logging.WARNING)  # issued by the parent already
    return partial(layout_faults, SceneDataset(root))


def _corners(sandbox: PlacementSandbox) -> dict[str, Array]:
    """Returns the corners (4, K) of all movable bodies, by body."""
    return {
        name: np.concatenate(
            [sandbox.world_from(name) @ body_points(s) for s in body.shapes], axis=1
        )
        for name, body in sandbox.bodies.items()
        if body.group in ("object", "furniture") and body.shapes
    }
