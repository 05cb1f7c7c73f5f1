"""Conversion of Habitat's rearrangement episodes (RearrangeDataset-v0), in both directions.

The conversion is lossless. Reading and writing a Habitat file reproduces it to 1e-6; our own
episodes are reproduced except for the sign of quaternions and full turns of the base.

Mapping of the fields (Habitat is y-up, the world is z-up):

- ``rigid_objs``, ``targets``: (4, 4) matrices, row-major, of an object's frame: origin at the
  centre of its visual mesh's bounding box, y up. A YCB scan is rotated by -90 degrees about x in
  it. That is exact for YCB objects. The embedded look-alikes rest on the same surfaces, but some
  are rotated or stand where the scan lies. To replay episodes to the millimetre, generate them
  with ``--objects YCB``.
- The n-th entry of a template in ``rigid_objs`` has the handle ``template_:000n``.
- A target without a goal is stored with its start as goal (Habitat requires goals).
- ``ao_states``: furniture -> link id -> joint position; see `habitat_layout` for the ids.
- ``target_receptacles``, ``goal_receptacles``: handle and link id of the body that carries the
  receptacle. Start receptacles are named in ``name_to_receptacle``; the goal receptacle is the one
  on that body whose box is nearest to the goal.
- ``start_position``, ``start_rotation`` (xyzw): the robot's base, x ahead. Habitat's generator
  leaves them zero and samples a start at each reset; `draw_starts` samples one for such files.
- ``markers``: the `scenes.markers` that Habitat names, and the episode's own.

Data without a field in Habitat's format (arm pose unless at rest, seed, held object, handle,
navigation goal, names of goal receptacles that do not follow from the position, handles with gaps)
is stored under ``hab_tasks`` in an episode's ``info``; env, split, seed, rejections and settled
poses of loose objects under ``hab_tasks`` beside the episodes. Habitat ignores both. Data without a
field in `Episode` (heights and tilts of the start, receptacles of clutter, other labels, markers or
paths, digits, the order of objects, unknown fields) is kept in `Episode.habitat`; it is written
back as long as it is consistent with the episode.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from hab_authoring.habitat.entry import OWN_KEY, START, HabitatEntries
from hab_authoring.habitat.fields import naming
from hab_tasks.episodes.generators.base import pose_scene
from hab_tasks.episodes.robot_start import RobotStarts, StartNoise
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import (
    Episode,
    EpisodeSet,
    MadeFrom,
    Pose,
    RobotStart,
    check_made_from,
    load_json,
    made_from,
)
from hab_tasks.errors import EpisodeError, GenerationError, RejectedSampleError
from hab_tasks.geometry import Pose7
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.typed_values import read_value
from hab_tasks.world.scenes.habitat.dataset import SPLIT_MACROS, SceneDataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.spec import ObjectTemplate

Progress = Callable[[int, int], None]
_SET_FIELDS = ("env", "split", "seed", "rejections")


def is_habitat(file: Path) -> bool:
    """Whether a file contains episodes in Habitat's format, not in ours.

    Raises:
        EpisodeError: Absent, damaged, or neither.
    """
    return "schema" not in _load(file)


def read_habitat(
    file: Path,
    dataset: SceneDataset,
    objects: Mapping[str, ObjectTemplate],
    env_id: str | None = None,
    progress: Progress | None = None,
) -> EpisodeSet:
    """Reads Habitat's episode file.

    Args:
        file: ``.json`` or ``.json.gz``.
        dataset: The scene dataset of its layouts.
        objects: Template name -> template of the movable objects.
        env_id: Environment of the episodes; None for the one in the file, or inferred from its
            receptacles.
        progress: Called with (episodes ready, all) after each one.

    Raises:
        EpisodeError: With file, episode and invalid field.
        DatasetError: The dataset is damaged.
    """
    raw = _load(file)
    if "schema" in raw:
        raise EpisodeError(f"{file}: not Habitat's format; read it with `read_episodes`.")
    entries = HabitatEntries(dataset, objects)
    with naming(str(file), OWN_KEY):
        own = dict(raw.get(OWN_KEY) or {})
    where, kind = f"{file}: {OWN_KEY}", dict[str, dict[str, Pose]]
    loose = read_value(kind, own.get("scenes", {}), f"{where}: scenes", EpisodeError)
    episodes = []
    for index, entry in enumerate(raw["episodes"]):
        name = entry.get("episode_id", index) if isinstance(entry, dict) else index
        episodes.append(entries.to_episode(entry, f"{file}: episode {name!r}", loose))
        if progress is not None:
            progress(index + 1, len(raw["episodes"]))
    parsed = {**_inferred(episodes, dataset), **own, **({"env": env_id} if env_id else {})}
    origin = made_from(dataset, objects)
    with naming(str(file), OWN_KEY):
        if "made_from" in own:
            stated = read_value(MadeFrom, own["made_from"], f"{where}: made_from", EpisodeError)
            check_made_from(str(file), dataset.name, stated, origin)
            origin = stated
        return EpisodeSet(
            env=str(parsed["env"]),
            scene_dataset=dataset.name,
            split=str(parsed["split"]),
            seed=int(parsed["seed"]),
            made_from=origin,
            episodes=tuple(episodes),
            rejections={str(k): int(v) for k, v in parsed["rejections"].items()},
            habitat={k: v for k, v in raw.items() if k not in ("episodes", OWN_KEY)},
        )


def to_habitat(
    episodes: EpisodeSet,
    dataset: SceneDataset,
    objects: Mapping[str, ObjectTemplate],
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Returns the content of a Habitat episode file.

    Args:
        episodes: The episodes.
        dataset: Their scene dataset.
        objects: Template name -> template of their movable objects.
        progress: Called with (episodes ready, all) after each one.

    Raises:
        EpisodeError: They are for another dataset, or refer to something it lacks.
        DatasetError: The dataset is damaged.
    """
    now = made_from(dataset, objects)
    where = f"{episodes.env}, split {episodes.split}, seed {episodes.seed}"
    dataset.check_made_for(episodes.scene_dataset, where)
    check_made_from(where, dataset.name, episodes.made_from, now)
    translate = HabitatEntries(dataset, objects)
    entries = []
    for episode in episodes.episodes:
        entries.append(translate.to_entry(episode))
        if progress is not None:
            progress(len(entries), len(episodes))
    parsed = _inferred(list(episodes.episodes), dataset)
    own = {k: getattr(episodes, k) for k in _SET_FIELDS if getattr(episodes, k) != parsed[k]}
    if episodes.made_from != now:
        own["made_from"] = asdict(episodes.made_from)
    loose: dict[str, dict[str, Pose7]] = {e.scene_id: e.loose for e in episodes.episodes if e.loose}
    if loose:
        own["scenes"] = loose
    return {**episodes.habitat, **({OWN_KEY: own} if own else {}), "episodes": entries}


def _load(file: Path) -> dict[str, Any]:
    raw = load_json(file)
    if not isinstance(raw, dict) or not isinstance(raw.get("episodes"), list):
        raise EpisodeError(f"{file}: no list `episodes` in it, so not an episode file.")
    return raw


def _inferred(episodes: list[Episode], dataset: SceneDataset) -> dict[str, Any]:
    """Infers the data of the set from Habitat's episodes alone."""
    scenes = {episode.scene_id for episode in episodes}
    splits = [s for s in SPLIT_MACROS if scenes and scenes <= set(dataset.scenes_of_split(s))]
    bodies = {ref[1] for e in episodes for t in e.targets for ref in (t.start, t.goal) if ref}
    if any("/drawer" in body for body in bodies):
        env = "HabSetTable-v1"
    elif any(body.startswith("fridge_:") for body in bodies):
        env = "HabPrepareGroceries-v1"
    else:
        env = "HabTidyHouse-v1"
    return {"env": env, "split": splits[0] if splits else "none", "seed": 0, "rejections": {}}


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
    starts = RobotStarts(sandbox, rng, ArmKinematics(sandbox.robot), _AT_REST)
    for _ in range(_TRIES):
        try:
            base = starts.anywhere().base
        except RejectedSampleError:
            continue
        robot = RobotStart.of(sandbox.robot, base, sandbox.robot.rest_qpos_rad)
        return replace(episode, robot=robot, habitat={**episode.habitat, START: list(base)})
    raise GenerationError(f"{episode.id}: no free floor for the robot in {episode.scene_id}.")
