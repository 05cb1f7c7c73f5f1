"""Robot starts for Habitat's episodes, whose files have none: Habitat samples one at each reset.

Here one start is sampled from the episode's seed and kept: a random free pose with random heading,
the arm at rest, without contact. Written back to Habitat's format, the file again has no start.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hab_authoring.habitat.convert import Progress
from hab_authoring.habitat.entry import START
from hab_tasks.episodes.generators.base import pose_scene
from hab_tasks.episodes.robot_start import RobotStarts, StartNoise
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import Episode, EpisodeSet, RobotStart
from hab_tasks.errors import GenerationError, RejectedSampleError
from hab_tasks.robots.fetch import FETCH
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.world.scenes.habitat.dataset import SceneDataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.spec import ObjectTemplate

_AT_REST = StartNoise(ee_m=0.0)
_TRIES = 10


def draw_starts(
    episodes: EpisodeSet,
    dataset: SceneDataset,
    objects: Mapping[str, ObjectTemplate],
    progress: Progress | None = None,
) -> EpisodeSet:
    """Samples a robot start for every episode whose Habitat file has none.

    Args:
        episodes: Episodes of `read_habitat`; those with a start are unchanged.
        dataset: Their scene dataset.
        objects: Template name -> template of the movable objects.
        progress: Called with (episodes ready, all) after each one.

    Raises:
        GenerationError: An episode has no free floor.
    """
    done = list(episodes.episodes)
    missing = [i for i, e in enumerate(done) if e.habitat.get(START, ...) is None]
    sandbox: PlacementSandbox | None = None
    for count, index in enumerate(sorted(missing, key=lambda i: done[i].scene_id)):
        scene_id = done[index].scene_id
        if sandbox is None:
            sandbox = PlacementSandbox(load_scene(dataset, scene_id), dict(objects))
        elif sandbox.spec.scene_id != scene_id:
            sandbox.load(load_scene(dataset, scene_id))
        done[index] = _with_start(done[index], sandbox)
        if progress is not None:
            progress(count + 1, len(missing))
    return replace(episodes, episodes=tuple(done))


def _with_start(episode: Episode, sandbox: PlacementSandbox) -> Episode:
    pose_scene(sandbox, episode.objects, episode.joints)
    rng = np.random.default_rng(episode.seed)
    starts = RobotStarts(sandbox, rng, ArmKinematics(FETCH), _AT_REST)
    for _ in range(_TRIES):
        try:
            base = starts.anywhere().base
        except RejectedSampleError:
            continue
        robot = RobotStart(base=base, arm_qpos_rad=FETCH.rest_qpos_rad)
        return replace(episode, robot=robot, habitat={**episode.habitat, START: list(base)})
    raise GenerationError(f"{episode.id}: no free floor for the robot in {episode.scene_id}.")
