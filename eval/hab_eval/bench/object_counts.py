"""Episodes of suite regressions: one start state with increasing numbers of objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hab_eval.errors import BenchError
from hab_tasks.episodes import Episode, EpisodeRequest, load_episodes
from hab_tasks.episodes.placing import Placer
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.spots import Spot
from hab_tasks.geometry import Pose7
from hab_tasks.object_names import TRAIN_OBJECTS
from hab_tasks.world.scenes.floor import CELL_M
from hab_tasks.world.scenes.habitat.dataset import resolve_dataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.objects import load_objects
from hab_tasks.world.scenes.spec import Receptacle

PATCH_CELLS = 6
"""Edge length of the square floor patches for additional objects [cells]."""

AWAY_M = 1.5
"""Minimum distance of a patch's center from the robot."""

SPARE = 1.2
"""Placed objects / required objects; those that do not stay in place are left out."""

FIRST_NUMBER = 1000
"""First instance number of additional objects, larger than any in generated episodes."""


def episodes_by_object_count(
    request: EpisodeRequest, counts: Sequence[int], seed: int = 0
) -> tuple[Episode, ...]:
    """Returns copies of the first generated episode with different numbers of movable objects.

    The target objects come first, then the generated clutter, then additional objects on the floor
    far from the robot. The objects of each episode are a subset of those of the larger ones.

    Args:
        request: Episode set; its scene must be given.
        counts: Numbers of movable objects, including the target objects.
        seed: Seed of the placement of additional objects.

    Raises:
        BenchError: The floor has too little room.
    """
    assert request.scene is not None
    (episode,) = load_episodes(request, 1).episodes
    spec = load_scene(resolve_dataset(request.scene_dataset), request.scene)
    sandbox = PlacementSandbox(spec, load_objects(request.objects))
    missing = max(0, max(counts) - len(episode.objects))
    further = _on_floor(sandbox, episode, round(SPARE * missing), np.random.default_rng(seed))
    if len(further) < missing:
        raise BenchError(
            f"Floor of {request.scene}: room for {len(further)} of {missing} additional objects. "
            "Use another --scene."
        )
    targets = {target.object: episode.objects[target.object] for target in episode.targets}
    objects = list({**targets, **episode.objects, **further}.items())
    return tuple(
        replace(episode, id=f"{episode.id}/{count}", objects=dict(objects[:count]))
        for count in counts
    )


def _on_floor(
    sandbox: PlacementSandbox, episode: Episode, count: int, rng: np.random.Generator
) -> dict[str, Pose7]:
    """Places `count` additional objects; returns name -> pose of those that stay in place."""
    templates = [TRAIN_OBJECTS[number % len(TRAIN_OBJECTS)] for number in range(count)]
    names = [f"{template}_:{FIRST_NUMBER + number}" for number, template in enumerate(templates)]
    sandbox.show((*episode.objects, *names))
    for name, pose in episode.objects.items():
        sandbox.place(name, pose)
    patches = floor_patches(sandbox, np.array(episode.robot.base[:2]))
    placer = Placer(sandbox, rng)
    for name in names:
        placer.put(name, patches)
    settled = placer.settle()
    return {name: settled[name] for name in names if name in settled}


def floor_patches(sandbox: PlacementSandbox, robot_m: np.ndarray) -> list[Spot]:
    """Returns disjoint patches of free floor at least `AWAY_M` from the robot's position (2,)."""
    free = sandbox.floor().cells_by_distance(robot_m, 0.0, AWAY_M)
    cells = np.round((free - free.min(axis=0)) / CELL_M).astype(int) if len(free) else free
    middles = free[(cells % PATCH_CELLS == 0).all(axis=1)]
    half_m = PATCH_CELLS * CELL_M / 2
    return [
        Spot(
            receptacle=Receptacle(
                name=f"floor_{number}",
                body="floor",
                body_from_box=(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
                half_size_m=(half_m, half_m, half_m),
                up=(0.0, 0.0, 1.0),
            ),
            center_m=np.array([x, y, 0.0]),
            axes=np.eye(3)[:, :2],
            half_m=np.array([half_m, half_m]),
            height_m=2 * half_m,
            joints={},
        )
        for number, (x, y) in enumerate(middles)
    ]
