"""Habitat's own rearrangement episodes (RearrangeDataset-v0): read, write, exchange.

Nothing is lost either way. A file that was read is written again as it was, to 1e-6; our own
episodes come back as they were, but for the sign of quaternions and whole turns of the base.

What is what (Habitat is y-up, the world is z-up):

- ``rigid_objs``, ``targets``: (4, 4) matrices, row by row, of an object's frame: origin in the
  middle of its visual mesh's box, y up. A YCB scan lies in it turned by -90 degrees about x. That
  is exact for YCB objects. The embedded look-alikes rest on the same surfaces, but some are turned
  or stand where the scan lies: make episodes with ``--objects YCB`` to replay them to the
  millimetre.
- The n-th entry of a template in ``rigid_objs`` has the handle ``template_:000n``.
- A target whose goal is its start has none (Habitat has no targets without goals).
- ``ao_states``: furniture -> link id -> joint position; see `habitat_layout` for the ids.
- ``target_receptacles``, ``goal_receptacles``: handle and link id of what carries the receptacle.
  Start receptacles are named in ``name_to_receptacle``; a goal's is the one on that body whose box
  is nearest to the goal.
- ``start_position``, ``start_rotation`` (xyzw): the robot's base, x ahead. Habitat's generator
  leaves them zero, and a start is drawn at each reset: `habitat_start` draws one for such files.
- ``markers``: those of `scenes.markers` that Habitat names, and the episode's own.

What Habitat's format has no place for (arm pose unless at rest, seed, held object, handle,
navigation goal, names of goal receptacles that their place does not tell, handles with gaps) lies
under ``hab_tasks`` in an episode's ``info``; env, split, seed, rejections and settled poses of
loose objects under ``hab_tasks`` beside the episodes. Habitat reads neither. What an `Episode` has
no place for (heights and tilts of the start, receptacles of clutter, other labels, markers or
paths, digits, the order of objects, unknown fields) lies in `Episode.habitat`; it is written back
as long as the episode still means the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hab_tasks.episodes.fields import load_json, naming, read_pose
from hab_tasks.episodes.habitat_entry import OWN_KEY, HabitatEntries
from hab_tasks.episodes.provenance import check_made_from, made_from, read_made_from
from hab_tasks.episodes.schema import Episode, EpisodeSet, save_json
from hab_tasks.errors import EpisodeError
from hab_tasks.geometry import Pose7
from hab_tasks.scenes.dataset import SPLIT_MACROS, SceneDataset
from hab_tasks.scenes.spec import ObjectTemplate

Progress = Callable[[int, int], None]
_SET_FIELDS = ("env", "split", "seed", "rejections")


def is_habitat(file: Path) -> bool:
    """Whether a file holds Habitat's episodes, and not ours.

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
        dataset: The scene dataset that its layouts are in.
        objects: Template name -> template of the movable objects.
        env_id: The environment they are for; None for the one that the file tells, or that its
            receptacles suggest.
        progress: Called with (episodes ready, all) after each one.

    Raises:
        EpisodeError: Names the file, the episode and the field that is wrong.
        DatasetError: The dataset is damaged.
    """
    raw = _load(file)
    if "schema" in raw:
        raise EpisodeError(f"{file}: not Habitat's format; read it with `read_episodes`.")
    entries = HabitatEntries(dataset, objects)
    with naming(str(file), OWN_KEY):
        own = dict(raw.get(OWN_KEY) or {})
        loose = {
            str(scene): {str(k): read_pose(p) for k, p in poses.items()}
            for scene, poses in own.get("scenes", {}).items()
        }
    episodes = []
    for index, entry in enumerate(raw["episodes"]):
        name = entry.get("episode_id", index) if isinstance(entry, dict) else index
        episodes.append(entries.to_episode(entry, f"{file}: episode {name!r}", loose))
        if progress is not None:
            progress(index + 1, len(raw["episodes"]))
    told = {**_told(episodes, dataset), **own, **({"env": env_id} if env_id else {})}
    origin = made_from(dataset, objects)
    with naming(str(file), OWN_KEY):
        if "made_from" in own:
            stated = read_made_from(own["made_from"])
            check_made_from(str(file), dataset.name, stated, dataset, origin)
            origin = stated
        return EpisodeSet(
            env=str(told["env"]),
            scene_dataset=dataset.name,
            split=str(told["split"]),
            seed=int(told["seed"]),
            made_from=origin,
            episodes=tuple(episodes),
            rejections={str(k): int(v) for k, v in told["rejections"].items()},
            habitat={k: v for k, v in raw.items() if k not in ("episodes", OWN_KEY)},
        )


def to_habitat(
    episodes: EpisodeSet,
    dataset: SceneDataset,
    objects: Mapping[str, ObjectTemplate],
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Returns what Habitat's episode file holds for these episodes.

    Args:
        episodes: The episodes.
        dataset: The scene dataset that they are for.
        objects: Template name -> template of the movable objects that they were made with.
        progress: Called with (episodes ready, all) after each one.

    Raises:
        EpisodeError: They are for another dataset, or name something that it does not have.
        DatasetError: The dataset is damaged.
    """
    now = made_from(dataset, objects)
    check_made_from(
        f"{episodes.env}, split {episodes.split}, seed {episodes.seed}",
        episodes.scene_dataset,
        episodes.made_from,
        dataset,
        now,
    )
    translate = HabitatEntries(dataset, objects)
    entries = []
    for episode in episodes.episodes:
        entries.append(translate.to_entry(episode))
        if progress is not None:
            progress(len(entries), len(episodes))
    told = _told(list(episodes.episodes), dataset)
    own = {k: getattr(episodes, k) for k in _SET_FIELDS if getattr(episodes, k) != told[k]}
    if episodes.made_from != now:
        own["made_from"] = asdict(episodes.made_from)
    loose: dict[str, dict[str, Pose7]] = {e.scene_id: e.loose for e in episodes.episodes if e.loose}
    if loose:
        own["scenes"] = loose
    return {**episodes.habitat, **({OWN_KEY: own} if own else {}), "episodes": entries}


def write_habitat(
    episodes: EpisodeSet,
    file: Path,
    dataset: SceneDataset,
    objects: Mapping[str, ObjectTemplate],
) -> None:
    """Writes Habitat's episode file aside and renames it; see `to_habitat`."""
    save_json(to_habitat(episodes, dataset, objects), file, sort_keys=False)


def _load(file: Path) -> dict[str, Any]:
    raw = load_json(file)
    if not isinstance(raw, dict) or not isinstance(raw.get("episodes"), list):
        raise EpisodeError(f"{file}: no list `episodes` in it, so not an episode file.")
    return raw


def _told(episodes: list[Episode], dataset: SceneDataset) -> dict[str, Any]:
    """Returns what Habitat's episodes alone tell about their set."""
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
