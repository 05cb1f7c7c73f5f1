"""Conversion of single episodes from and to Habitat's format; see `convert` for the mapping."""

from __future__ import annotations

import math
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from hab_authoring.habitat.fields import (
    body_of,
    close,
    habitat_handles,
    naming,
    object_frame,
    ordered_like,
    plain_name,
    read_base,
    read_matrix,
    target_order,
)
from hab_authoring.habitat.layout import HabitatLayout
from hab_tasks.episodes.schema import (
    Episode,
    Rearrangement,
    ReceptacleRef,
    RobotStart,
    template_of,
    with_loose,
)
from hab_tasks.errors import EpisodeError, UnknownNameError
from hab_tasks.geometry import WORLD_FROM_HABITAT, Array, Pose7, from_matrix, to_matrix
from hab_tasks.robots import DEFAULT_ROBOT
from hab_tasks.typed_values import number, read_value
from hab_tasks.world.scenes.habitat.dataset import SceneDataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.spec import ObjectTemplate

OWN_KEY = "hab_tasks"
"""Key of the data that Habitat's format has no field for; ignored by Habitat."""

START = "start"
"""Key in `Episode.habitat` for files without a robot start: the sampled base, None before."""

OBJECT_CONFIGS = "data/objects/ycb/configs/"
DATASET_FOLDERS = {"replicaCAD": "data/replica_cad"}
"""Dataset folders in Habitat's episodes; others are expected in ``data/NAME``."""

SAME = 1e-6
"""Tolerance for equality of numbers in two files."""

MEANT = 1e-5
"""Tolerance for consistency with an episode; Habitat writes five digits."""

_TOLD = frozenset({"id", "scene_id", "robot", "objects", "targets", "joints", "loose", "habitat"})
_WORLD_FROM_HABITAT = to_matrix(WORLD_FROM_HABITAT)


class HabitatEntries:
    """Converts single episodes of one dataset, with one set of movable objects."""

    def __init__(self, dataset: SceneDataset, objects: Mapping[str, ObjectTemplate]) -> None:
        self._dataset, self._templates = dataset, objects
        self._layouts: dict[str, HabitatLayout] = {}
        self._frames: dict[str, tuple[Array, Array]] = {}

    def to_entry(self, episode: Episode) -> dict[str, Any]:
        """Returns an episode in Habitat's format.

        Raises:
            EpisodeError: It refers to something the dataset lacks.
        """
        plain = self._write(episode)
        entry, parsed = self._with_kept(plain, episode)
        own = _missing(episode, parsed)
        if own:
            entry = entry | {"info": {**(entry.get("info") or {}), OWN_KEY: own}}
        return entry

    def to_episode(self, entry: Any, where: str, loose: Mapping[str, dict[str, Pose7]]) -> Episode:
        """Returns the episode of an entry of a Habitat file.

        Args:
            entry: The entry.
            where: File and episode, for messages.
            loose: Scene id -> poses of the layout's loose objects, if the file has them.

        Raises:
            EpisodeError: A field is missing or malformed, or refers to something the dataset lacks.
        """
        if not isinstance(entry, dict):
            raise EpisodeError(f"{where}: expected an object, found {type(entry).__name__}.")
        parsed = self._read(entry, where)
        plain, given = self._write(parsed), dict(entry)
        own: dict[str, Any] = {}
        with naming(where, "info"):
            if OWN_KEY in (given.get("info") or {}):
                own = dict(given["info"][OWN_KEY])
                given["info"] = {k: v for k, v in given["info"].items() if k != OWN_KEY}
        kept = {k: v for k, v in given.items() if k not in plain or not close(plain[k], v, SAME)}
        absent = [key for key in plain if key not in given]
        habitat: dict[str, Any] = {k: v for k, v in (("kept", kept), ("absent", absent)) if v}
        if not own and parsed.robot.base == (0.0, 0.0, 0.0):
            habitat[START] = None
        parsed = replace(parsed, habitat=habitat, loose=loose.get(parsed.scene_id, {}))
        with naming(where, f"info.{OWN_KEY}"):
            return _with_missing(parsed, own, f"{where}, field info.{OWN_KEY}") if own else parsed

    def _write(self, episode: Episode) -> dict[str, Any]:
        """Returns the entry without kept data and without data that Habitat has no field for."""
        where = f"episode {episode.id!r}"
        with naming(where, "scene_id"):
            layout = self._layout(episode.scene_id)
        with naming(where, "objects"):
            matrices = {name: self._matrix(name, p) for name, p in episode.objects.items()}
        with naming(where, "joints"):
            states = {
                furniture: {str(layout.link_of_joint(furniture, j)): q for j, q in joints.items()}
                for furniture, joints in episode.joints.items()
            }
        handles = habitat_handles(episode.objects)
        listed = sorted((theirs, ours) for ours, theirs in handles.items())
        base = episode.robot.base
        x, y, yaw = base if list(base) != episode.habitat.get(START) else (0.0, 0.0, 0.0)
        half = math.remainder(yaw, math.tau) / 2
        return {
            "episode_id": episode.id,
            **self._files(episode.scene_id),
            "start_position": [x, 0.0, 0.0 - y],
            "start_rotation": [0.0, math.sin(half), 0.0, math.cos(half)],
            "ao_states": states,
            "rigid_objs": [
                [f"{template_of(theirs)}.object_config.json", matrices[ours].tolist()]
                for theirs, ours in listed
            ],
            "markers": layout.markers(episode.handle.marker if episode.handle else None),
            **self._target_fields(episode, layout, matrices, handles),
        }

    def _files(self, scene_id: str) -> dict[str, Any]:
        name = self._dataset.name
        folder = DATASET_FOLDERS.get(name, f"data/{name}")
        return {
            "scene_id": f"{folder}/configs/scenes/{scene_id}.scene_instance.json",
            "scene_dataset_config": f"{folder}/{name}.scene_dataset_config.json",
            "additional_obj_config_paths": [OBJECT_CONFIGS],
        }

    def _target_fields(
        self,
        episode: Episode,
        layout: HabitatLayout,
        matrices: dict[str, Array],
        handles: dict[str, str],
    ) -> dict[str, Any]:
        targets = {handles[target.object]: target for target in episode.targets}
        with naming(f"episode {episode.id!r}", "targets"):
            return {
                "targets": {
                    handle: (
                        matrices[target.object]
                        if target.world_from_goal is None
                        else self._matrix(target.object, target.world_from_goal)
                    ).tolist()
                    for handle, target in targets.items()
                },
                "target_receptacles": [_place(layout, t.start) for t in episode.targets],
                "goal_receptacles": [_place(layout, t.goal) for t in episode.targets],
                "name_to_receptacle": {h: t.start[0] for h, t in targets.items() if t.start},
                "info": {"object_labels": {h: f"any_targets|{i}" for i, h in enumerate(targets)}},
            }

    def _with_kept(self, plain: dict[str, Any], episode: Episode) -> tuple[dict[str, Any], Episode]:
        """Restores data of the episode's Habitat file that is consistent with the episode.

        Returns:
            The entry, and the episode read from it.
        """
        kept: dict[str, Any] = episode.habitat.get("kept", {})
        keys = [*kept, *episode.habitat.get("absent", ())]
        entry, parsed = plain, None
        for chosen in (keys, *([key] for key in keys)) if keys else ():
            trial = entry | {key: kept[key] for key in chosen if key in kept}
            trial = {k: v for k, v in trial.items() if k in kept or k not in chosen}
            trial = ordered_like(trial, plain)
            meant = self._meant_by(trial, plain)
            if meant is not None:
                entry, parsed = trial, meant
                if chosen is keys:
                    break
        return entry, parsed or self._read(plain, f"episode {episode.id!r}")

    def _meant_by(self, trial: dict[str, Any], plain: dict[str, Any]) -> Episode | None:
        """Returns the episode read from `trial`, or None if `plain` gives a different one."""
        try:
            parsed = self._read(trial, "kept")
            return parsed if close(self._write(parsed), plain, MEANT) else None
        except EpisodeError:
            return None

    def _read(self, entry: dict[str, Any], where: str) -> Episode:
        """Reads an episode from Habitat's fields."""
        with naming(where, "scene_id"):
            scene_id = Path(entry["scene_id"]).name.removesuffix(".scene_instance.json")
            layout = self._layout(scene_id)
        with naming(where, "episode_id"):
            episode_id = str(entry["episode_id"])
        self._check_dataset(entry, where)
        with naming(where, "rigid_objs"):
            objects = self._objects(entry["rigid_objs"], where)
        with naming(where, "ao_states"):
            joints = {
                str(furniture): {
                    layout.joint(furniture, int(link)): number(q) for link, q in states.items()
                }
                for furniture, states in entry["ao_states"].items()
            }
        return Episode(
            id=episode_id,
            scene_id=scene_id,
            seed=zlib.crc32(f"{scene_id}/{episode_id}".encode()) >> 1,
            robot=RobotStart.of(
                DEFAULT_ROBOT, read_base(entry, where), DEFAULT_ROBOT.rest_qpos_rad
            ),
            objects=objects,
            targets=self._targets(entry, layout, objects, where),
            joints=joints,
        )

    def _check_dataset(self, entry: dict[str, Any], where: str) -> None:
        with naming(where, "scene_dataset_config"):
            file = Path(entry.get("scene_dataset_config", "default")).name
            name = file.removesuffix(".scene_dataset_config.json")
        if name != file:
            self._dataset.check_made_for(name, f"{where}, field scene_dataset_config")

    def _objects(self, listed: Iterable[Any], where: str) -> dict[str, Pose7]:
        counts: Counter[str] = Counter()
        objects = {}
        for index, entry in enumerate(listed):
            with naming(where, f"rigid_objs[{index}]"):
                config, matrix = entry
                name = Path(config).name.removesuffix(".object_config.json")
                handle = f"{name}_:{counts[name]:04d}"
                objects[handle] = self._pose(handle, matrix)
                counts[name] += 1
        return objects

    def _targets(
        self,
        entry: dict[str, Any],
        layout: HabitatLayout,
        objects: dict[str, Pose7],
        where: str,
    ) -> tuple[Rearrangement, ...]:
        with naming(where, "name_to_receptacle"):
            names = {k: plain_name(v) for k, v in (entry.get("name_to_receptacle") or {}).items()}
            for name in names.values():
                layout.check_receptacle(name)
        with naming(where, "targets"):
            goals = dict(entry["targets"])
            for handle in goals:
                if handle not in objects:
                    raise UnknownNameError("object of rigid_objs", handle, objects)
            order = target_order(entry, goals)
        found = []
        for index, handle in enumerate(order):
            with naming(where, f"targets[{handle!r}]"):
                goal: Pose7 | None = self._pose(handle, goals[handle])
            here, there = self._middle(handle, objects[handle]), self._middle(handle, goal)
            if close(objects[handle], goal, SAME):
                goal = None
            with naming(where, f"target_receptacles[{index}]"):
                body = body_of(entry, "target_receptacles", index, len(order))
                start = layout.receptacle(*body, names.get(handle), here)
            with naming(where, f"goal_receptacles[{index}]"):
                body = body_of(entry, "goal_receptacles", index, len(order))
                end = layout.receptacle(*body, None, there)
            found.append(Rearrangement(object=handle, start=start, goal=end, world_from_goal=goal))
        return tuple(found)

    def _layout(self, scene_id: str) -> HabitatLayout:
        if scene_id not in self._layouts:
            self._layouts[scene_id] = HabitatLayout(load_scene(self._dataset, scene_id))
        return self._layouts[scene_id]

    def _frame(self, handle: str) -> tuple[Array, Array]:
        """Returns `object_frame` (4, 4) of the template of a handle, and its inverse."""
        name = template_of(handle)
        if name not in self._frames:
            if name not in self._templates:
                raise UnknownNameError("object template", name, self._templates)
            frame = object_frame(self._templates[name])
            self._frames[name] = frame, np.linalg.inv(frame).astype(np.float64)
        return self._frames[name]

    def _matrix(self, handle: str, world_from_object: Pose7) -> Array:
        """Returns Habitat's matrix of an object's pose."""
        return _WORLD_FROM_HABITAT.T @ to_matrix(world_from_object) @ self._frame(handle)[1]

    def _pose(self, handle: str, habitat_from_object: Any) -> Pose7:
        matrix = read_matrix(habitat_from_object)
        return from_matrix(_WORLD_FROM_HABITAT @ matrix @ self._frame(handle)[0])

    def _middle(self, handle: str, world_from_object: Pose7) -> Array:
        """Returns the centre (3,) of an object in the world."""
        return (_WORLD_FROM_HABITAT @ self._matrix(handle, world_from_object))[:3, 3]


def _missing(episode: Episode, parsed: Episode) -> dict[str, Any]:
    """Returns the data of `episode` that `parsed`, read from Habitat's fields, lacks."""
    mine, read = (asdict(replace(e, loose={}, habitat={})) for e in (episode, parsed))
    missing = {k: v for k, v in mine.items() if k not in _TOLD and v != read[k]}
    if not close(mine["robot"]["arm_qpos_rad"], read["robot"]["arm_qpos_rad"], SAME):
        missing["arm_qpos_rad"] = mine["robot"]["arm_qpos_rad"]
    handles = {theirs: ours for ours, theirs in habitat_handles(episode.objects).items()}
    if renamed := {theirs: ours for theirs, ours in handles.items() if theirs != ours}:
        missing["handles"] = renamed
    receptacles = [(t.start, t.goal) for t in episode.targets]
    if receptacles != [(t.start, t.goal) for t in parsed.targets]:
        missing["receptacles"] = receptacles
    return missing


def _with_missing(parsed: Episode, missing: dict[str, Any], where: str) -> Episode:
    """Adds the data of `_missing` to an episode read from Habitat's fields."""
    rest = dict(missing)
    raw = asdict(replace(parsed, loose={}))
    if "arm_qpos_rad" in rest:
        raw["robot"]["arm_qpos_rad"] = rest.pop("arm_qpos_rad")
    handles = rest.pop("handles", {})
    raw["objects"] = {handles.get(k, k): pose for k, pose in raw["objects"].items()}
    for target in raw["targets"]:
        target["object"] = handles.get(target["object"], target["object"])
    if "receptacles" in rest:
        for target, pair in zip(raw["targets"], rest.pop("receptacles"), strict=True):
            target["start"], target["goal"] = pair
    episode = read_value(Episode, raw | rest, where, EpisodeError)
    return with_loose(episode, {parsed.scene_id: parsed.loose}, where)


def _place(layout: HabitatLayout, receptacle: ReceptacleRef | None) -> list[Any]:
    return [None, None] if receptacle is None else [*layout.instance_and_link(receptacle[1])]
