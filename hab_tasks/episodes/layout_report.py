"""Does a layout load, does it come to rest, and can the robot use it?"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from hab_tasks.episodes.workbench import Workbench
from hab_tasks.errors import HabError
from hab_tasks.geometry import Array
from hab_tasks.processes import worker_pool
from hab_tasks.scenes.dataset import SceneDataset
from hab_tasks.scenes.floor import body_points
from hab_tasks.scenes.layout_checks import check_layout
from hab_tasks.scenes.load import load_scene

MOVED_M = 0.01
WATCH_S = 2.0
FALLEN_M = -0.2
"""What lies wholly below this has fallen out of the room."""

_BEAT_S = 0.25
"""`Workbench.settle` may end after this long, when everything sleeps."""


def layout_faults(dataset: SceneDataset, scene_id: str) -> tuple[str, ...]:
    """Returns what is wrong with a layout, one line each: it must load, settle and be usable."""
    try:
        spec = load_scene(dataset, scene_id)
        report = check_layout(dataset, scene_id)
    except HabError as error:
        return (f"does not load: {error}",)
    return (*unrest(Workbench(spec, {})), *report.reasons)


def unrest(bench: Workbench) -> list[str]:
    """Returns what fell out of the room, and what still moves once the layout has settled.

    The layout starts as episodes do: settled, at rest, doors and drawers closed. Then no corner of
    any shape may move by more than `MOVED_M` in `WATCH_S`.
    """
    bench.show(())
    before = _corners(bench)
    for _ in range(round(WATCH_S / _BEAT_S)):
        bench.settle(_BEAT_S)
    after = _corners(bench)
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
        dataset: Whose layouts.
        scene_ids: Which of them.
        workers: Number of processes; 1 works in this one.
    """
    scenes = list(scene_ids)
    if workers == 1:
        yield from ((scene_id, layout_faults(dataset, scene_id)) for scene_id in scenes)
        return
    # What there is to be warned of, this process has said already.
    with worker_pool(workers, logging.disable, (logging.WARNING,)) as pool:
        yield from zip(scenes, pool.map(partial(_faults, dataset.root), scenes), strict=True)


def _faults(root: Path, scene_id: str) -> tuple[str, ...]:
    return layout_faults(SceneDataset(root), scene_id)


def _corners(bench: Workbench) -> dict[str, Array]:
    """Returns where the corners (4, K) of everything that can move are, by body."""
    return {
        name: np.concatenate([bench.world_from(name) @ body_points(s) for s in body.shapes], axis=1)
        for name, body in bench.bodies.items()
        if body.group in ("object", "furniture") and body.shapes
    }
