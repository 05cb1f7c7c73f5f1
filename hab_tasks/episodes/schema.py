"""Data model of an episode: layout, object poses, robot start and goals; frozen.

Files are JSON (``.json`` or ``.json.gz``): ``{"schema": 3, "env", "scene_dataset", "made_from",
"split", "seed", "scenes": {scene_id: {object name: pose}}, "episodes": [...]}``. Poses are
position [m] and quaternion wxyz in the z-up world. An episode always gives the same start state.
"""

from __future__ import annotations

import gzip
import json
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from hab_tasks.episodes.fields import load_json, naming, read_pose
from hab_tasks.episodes.provenance import MadeFrom, read_made_from
from hab_tasks.errors import EpisodeError
from hab_tasks.files import written_aside
from hab_tasks.geometry import Pose7
from hab_tasks.typed_values import integer, mapping, number, sequence, text

SCHEMA = 3
POSE_DIGITS = 6
"""Poses are rounded to a micrometre, in memory and in files, so that both give the same start."""

ARM_JOINT_COUNT = 7

ReceptacleRef = tuple[str, str]
"""Name of a receptacle, and the body (object name or ``articulation/link``) that carries it."""

Base = tuple[float, float, float]
"""x [m], y [m], yaw [rad] of the robot's base in the world."""


@dataclass(frozen=True, kw_only=True)
class RobotStart:
    """Start state of the robot: base and arm joints (7,) [rad]."""

    base: Base
    arm_qpos_rad: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Rearrangement:
    """A target of the episode, with start and goal.

    Attributes:
        object: Its name.
        start: Start receptacle; None if the robot holds the object.
        goal: Goal receptacle; None if the object only has to be picked.
        world_from_goal: Its pose at the goal (the object's frame, settled); None without a goal.
    """

    object: str
    start: ReceptacleRef | None = None
    goal: ReceptacleRef | None = None
    world_from_goal: Pose7 | None = None


@dataclass(frozen=True, kw_only=True)
class HandleRef:
    """A door or drawer to open or close: furniture name, its joint, and the handle's marker."""

    furniture: str
    joint: str
    marker: str


@dataclass(frozen=True, kw_only=True)
class NavigationGoal:
    """Navigation goal: a start pose of the skill `skill` (an env id)."""

    skill: str
    base: Base


@dataclass(frozen=True, kw_only=True)
class Episode:
    """A start state and its goals.

    Attributes:
        id: Unique within its set, e.g. ``HabPick-v1/replicaCAD/train/0/00007``.
        seed: Seed of the agent's and the environment's randomness during the episode.
        objects: Object name (``003_cracker_box_:0001``) -> start pose of every movable object in
            the episode.
        joints: Furniture name -> joint name -> position [m or rad]; other joints start at zero.
        loose: Handle -> settled pose of the layout's loose objects; one dict for all episodes of a
            layout, stored once per file.
        targets: The objects to rearrange, in the task's order.
        held: Handle of the object that starts in the grasp.
        handle: The door or drawer that the skill is about.
        navigation: The goal of Navigate.
        habitat: Further data of the Habitat file that the episode was read from; see
            `hab_authoring.habitat.convert`.
    """

    id: str
    scene_id: str
    seed: int
    robot: RobotStart
    objects: dict[str, Pose7]
    targets: tuple[Rearrangement, ...] = ()
    held: str | None = None
    handle: HandleRef | None = None
    navigation: NavigationGoal | None = None
    joints: dict[str, dict[str, float]] = field(default_factory=dict)
    loose: dict[str, Pose7] = field(default_factory=dict)
    habitat: dict[str, Any] = field(default_factory=dict)

    @property
    def target(self) -> str:
        """Handle of the first object to rearrange; empty if there is none."""
        return self.targets[0].object if self.targets else ""


@dataclass(frozen=True, kw_only=True)
class EpisodeSet:
    """A list of episodes with its provenance.

    Attributes:
        made_from: Provenance: scene dataset, objects and generator.
        rejections: Reason -> number of candidates rejected during generation.
        habitat: Further data of a Habitat file, beside its episodes.
    """

    env: str
    scene_dataset: str
    split: str
    seed: int
    made_from: MadeFrom
    episodes: tuple[Episode, ...]
    rejections: dict[str, int] = field(default_factory=dict)
    habitat: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.episodes)


def template_of(name: str) -> str:
    """Returns the template of an object: ``003_cracker_box_:0001`` -> ``003_cracker_box``."""
    return name.rsplit("_:", 1)[0]


def rounded(world_from_object: Pose7) -> Pose7:
    """Rounds a pose to `POSE_DIGITS`, as in files."""
    return tuple(round(x, POSE_DIGITS) + 0.0 for x in world_from_object)  # type: ignore[return-value]


def write_episodes(episodes: EpisodeSet, file: Path) -> None:
    """Writes an episode file atomically."""
    raw = {"schema": SCHEMA, **asdict(episodes)}
    raw["scenes"] = {entry["scene_id"]: entry.pop("loose") for entry in raw["episodes"]}
    for entry in (raw, *raw["episodes"]):
        if not entry["habitat"]:
            del entry["habitat"]
    save_json(raw, file, sort_keys=True)


def save_json(value: Any, file: Path, *, sort_keys: bool) -> None:
    """Writes a ``.json`` or ``.json.gz`` file atomically."""
    data = (json.dumps(value, sort_keys=sort_keys) + "\n").encode()
    if file.suffix == ".gz":
        data = gzip.compress(data, mtime=0)
    with written_aside(file) as scratch:
        scratch.write_bytes(data)


def read_episodes(file: Path) -> EpisodeSet:
    """Reads an episode file.

    Raises:
        EpisodeError: Absent, damaged, of another schema version, or with an invalid field.
    """
    raw = load_json(file)
    version = raw.get("schema") if isinstance(raw, dict) else None
    if version != SCHEMA:
        raise EpisodeError(
            f"{file}: episode schema {version!r}; this version reads {SCHEMA}. "
            "Generate it again with `hab-tasks episodes`."
        )
    where = str(file)
    with naming(where, "scenes"):
        scenes = {
            scene: {name: read_pose(pose) for name, pose in mapping(poses).items()}
            for scene, poses in mapping(raw["scenes"]).items()
        }
    with naming(where, "episodes"):
        entries = list(enumerate(sequence(raw["episodes"])))
    with naming(where, "made_from"):
        origin = read_made_from(raw["made_from"])
    twice = [name for name, count in Counter(_id(e, i) for i, e in entries).items() if count > 1]
    if twice:
        raise EpisodeError(f"{file}: episode {twice[0]!r} appears twice.")
    with naming(where, "env, scene_dataset, split, seed, rejections"):
        return EpisodeSet(
            env=text(raw["env"]),
            scene_dataset=text(raw["scene_dataset"]),
            split=text(raw["split"]),
            seed=integer(raw["seed"]),
            made_from=origin,
            episodes=tuple(
                read_episode(entry, scenes, f"{where}: episode {_id(entry, index)!r}")
                for index, entry in entries
            ),
            rejections={k: integer(v) for k, v in mapping(raw.get("rejections", {})).items()},
            habitat=mapping(raw.get("habitat", {})),
        )


def read_episode(entry: Any, scenes: dict[str, dict[str, Pose7]], where: str) -> Episode:
    """Returns one entry of an episode file.

    Args:
        entry: The entry.
        scenes: Scene id -> the loose objects of all its episodes.
        where: File and episode, for messages.

    Raises:
        EpisodeError: A field is missing or malformed.
    """
    with naming(where, "scene_id"):
        scene_id = text(mapping(entry)["scene_id"])
        loose = scenes[scene_id]
    with naming(where, "robot"):
        robot = _robot(entry["robot"])
    with naming(where, "objects"):
        objects = {k: read_pose(v) for k, v in mapping(entry["objects"]).items()}
    with naming(where, "targets"):
        targets = tuple(_rearrangement(target, objects) for target in sequence(entry["targets"]))
    with naming(where, "held"):
        held = None if entry.get("held") is None else _among(entry["held"], objects)
    with naming(where, "handle"):
        handle = entry.get("handle")
        if handle is not None:
            handle = HandleRef(**{k: text(v) for k, v in mapping(handle).items()})
    with naming(where, "navigation"):
        goal = entry.get("navigation")
        if goal is not None:
            goal = NavigationGoal(skill=text(mapping(goal)["skill"]), base=_base(goal["base"]))
    with naming(where, "joints"):
        joints = {
            furniture: {joint: number(q) for joint, q in mapping(positions).items()}
            for furniture, positions in mapping(entry["joints"]).items()
        }
    with naming(where, "id, seed, habitat"):
        return Episode(
            id=text(entry["id"]),
            scene_id=scene_id,
            seed=integer(entry["seed"]),
            robot=robot,
            objects=objects,
            targets=targets,
            held=held,
            handle=handle,
            navigation=goal,
            joints=joints,
            loose=loose,
            habitat=mapping(entry.get("habitat", {})),
        )


def _id(entry: Any, index: int) -> Any:
    named = entry.get("id") if isinstance(entry, dict) else None
    return named if isinstance(named, str) else index


def _among(name: Any, objects: dict[str, Pose7]) -> str:
    if text(name) not in objects:
        raise ValueError(f"{name!r} is not among the objects")
    return name


def _robot(entry: dict[str, Any]) -> RobotStart:
    arm = tuple(number(x) for x in sequence(entry["arm_qpos_rad"]))
    if len(arm) != ARM_JOINT_COUNT:
        raise ValueError(f"arm_qpos_rad with {len(arm)} joints, expected {ARM_JOINT_COUNT}")
    return RobotStart(base=_base(entry["base"]), arm_qpos_rad=arm)


def _rearrangement(entry: dict[str, Any], objects: dict[str, Pose7]) -> Rearrangement:
    start, goal, pose = entry.get("start"), entry.get("goal"), entry.get("world_from_goal")
    return Rearrangement(
        object=_among(entry["object"], objects),
        start=None if start is None else _receptacle(start),
        goal=None if goal is None else _receptacle(goal),
        world_from_goal=None if pose is None else read_pose(pose),
    )


def _receptacle(values: Any) -> ReceptacleRef:
    name, body = sequence(values)
    return text(name), text(body)


def _base(values: Any) -> Base:
    x, y, yaw = (number(value) for value in sequence(values))
    return x, y, yaw
