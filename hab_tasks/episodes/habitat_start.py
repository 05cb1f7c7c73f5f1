"""Robot starts for Habitat's episodes: its files tell none, it draws one at each reset.

Here one is drawn from the episode's seed and kept: anywhere on the free floor with all things in
place, turned anyhow, the arm at rest, nothing touched. Written back, the file tells none again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hab_tasks.episodes.generators.base import stage
from hab_tasks.episodes.habitat import Progress
from hab_tasks.episodes.habitat_entry import START
from hab_tasks.episodes.refusal import RefusedError
from hab_tasks.episodes.robot_start import RobotStarts, StartNoise
from hab_tasks.episodes.schema import Episode, EpisodeSet, RobotStart
from hab_tasks.episodes.workbench import Workbench
from hab_tasks.errors import GenerationError
from hab_tasks.robots.fetch_spec import REST_QPOS_RAD
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.scenes.dataset import SceneDataset
from hab_tasks.scenes.load import load_scene
from hab_tasks.scenes.spec import ObjectTemplate

_AT_REST = StartNoise(ee_m=0.0)
_TRIES = 10


def draw_starts(
    episodes: EpisodeSet,
    dataset: SceneDataset,
    objects: Mapping[str, ObjectTemplate],
    progress: Progress | None = None,
) -> EpisodeSet:
    """Stands the robot somewhere in every episode whose Habitat file tells no start.

    Args:
        episodes: As `read_habitat` returns them; those with a start stay as they are.
        dataset: Their scene dataset.
        objects: Template name -> template of the movable objects.
        progress: Called with (episodes ready, all) after each one.

    Raises:
        GenerationError: An episode leaves no free floor.
    """
    done = list(episodes.episodes)
    missing = [i for i, e in enumerate(done) if e.habitat.get(START, ...) is None]
    bench: Workbench | None = None
    for count, index in enumerate(sorted(missing, key=lambda i: done[i].scene_id)):
        scene_id = done[index].scene_id
        if bench is None:
            bench = Workbench(load_scene(dataset, scene_id), dict(objects))
        elif bench.spec.scene_id != scene_id:
            bench.load(load_scene(dataset, scene_id))
        done[index] = _with_start(done[index], bench)
        if progress is not None:
            progress(count + 1, len(missing))
    return replace(episodes, episodes=tuple(done))


def _with_start(episode: Episode, bench: Workbench) -> Episode:
    stage(bench, episode.objects, episode.joints)
    rng = np.random.default_rng(episode.seed)
    starts = RobotStarts(bench, rng, ArmKinematics(), _AT_REST)
    for _ in range(_TRIES):
        try:
            base = starts.anywhere().base
        except RefusedError:
            continue
        robot = RobotStart(base=base, arm_qpos_rad=REST_QPOS_RAD)
        return replace(episode, robot=robot, habitat={**episode.habitat, START: list(base)})
    raise GenerationError(f"{episode.id}: no free floor for the robot in {episode.scene_id}.")
