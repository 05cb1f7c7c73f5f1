"""Episodes of suite objects: the same start with ever more objects in the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hab_eval.errors import BenchError
from hab_tasks.episodes import Episode, EpisodeRequest, load_episodes
from hab_tasks.episodes.placing import Placer
from hab_tasks.episodes.receptacles import Spot
from hab_tasks.episodes.workbench import Workbench
from hab_tasks.geometry import Pose7
from hab_tasks.scenes.dataset import resolve_dataset
from hab_tasks.scenes.floor import CELL_M
from hab_tasks.scenes.load import load_scene
from hab_tasks.scenes.objects import TRAIN_OBJECTS, load_objects
from hab_tasks.scenes.spec import Receptacle

PATCH_CELLS = 6
"""Further objects stand on square patches of the floor, so many cells along each side."""

AWAY_M = 1.5
"""The middle of a patch is at least this far from the robot."""

SPARE = 1.2
"""So many times the missing objects are put down; what does not stay is left out."""

FIRST_NUMBER = 1000
"""Further instances are numbered from here, after any of a generated episode."""


def crowded_episodes(
    request: EpisodeRequest, counts: Sequence[int], seed: int = 0
) -> tuple[Episode, ...]:
    """Returns the first generated episode with each number of movable objects.

    Those to rearrange come first, then the generated clutter, then further objects that stand on
    the floor far from the robot; whatever an episode holds, a larger one holds too.

    Args:
        request: Which episode; it names a scene.
        counts: Numbers of movable objects, those to rearrange included.
        seed: Where the further objects are put.

    Raises:
        BenchError: The floor has no room for so many.
    """
    assert request.scene is not None
    (episode,) = load_episodes(request, 1).episodes
    spec = load_scene(resolve_dataset(request.scene_dataset), request.scene)
    bench = Workbench(spec, load_objects(request.objects))
    missing = max(0, max(counts) - len(episode.objects))
    further = _on_floor(bench, episode, round(SPARE * missing), np.random.default_rng(seed))
    if len(further) < missing:
        raise BenchError(
            f"Floor of {request.scene}: room for {len(further)} further objects, not for {missing}."
            " Give another --scene."
        )
    targets = {target.object: episode.objects[target.object] for target in episode.targets}
    objects = list({**targets, **episode.objects, **further}.items())
    return tuple(
        replace(episode, id=f"{episode.id}/{count}", objects=dict(objects[:count]))
        for count in counts
    )


def _on_floor(
    bench: Workbench, episode: Episode, count: int, rng: np.random.Generator
) -> dict[str, Pose7]:
    """Returns handle -> pose of those of `count` further objects that stay on the floor."""
    names = [TRAIN_OBJECTS[number % len(TRAIN_OBJECTS)] for number in range(count)]
    handles = [f"{name}_:{FIRST_NUMBER + number}" for number, name in enumerate(names)]
    bench.show((*episode.objects, *handles))
    for handle, pose in episode.objects.items():
        bench.place(handle, pose)
    patches = floor_patches(bench, np.array(episode.robot.base[:2]))
    placer = Placer(bench, rng)
    for handle in handles:
        placer.put(handle, patches)
    settled = placer.settle()
    return {handle: settled[handle] for handle in handles if handle in settled}


def floor_patches(bench: Workbench, robot_m: np.ndarray) -> list[Spot]:
    """Returns patches of free floor that do not overlap, away from a robot at (2,)."""
    free = bench.floor().cells_by_distance(robot_m, 0.0, AWAY_M)
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
