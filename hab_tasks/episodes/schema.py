"""An episode as frozen data: which layout, what lies where, where the robot starts, what to do.

Files are JSON (``.json`` or ``.json.gz``): ``{"schema": 2, "env", "scene_dataset", "split", "seed",
"scenes": {scene_id: {object handle: pose}}, "episodes": [...]}``. Poses are position [m] and
quaternion wxyz in the z-up world. Replaying an episode gives the same start state, always.
"""

from __future__ import annotations

import gzip
import json
import math
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from hab_tasks.errors import EpisodeError, UnknownNameError
from hab_tasks.files import written_aside
from hab_tasks.geometry import Pose7

SCHEMA = 2
POSE_DIGITS = 6
"""Poses are rounded to a micrometre, in memory as in files, so that both give the same start."""

ARM_JOINT_COUNT = 7

ReceptacleRef = tuple[str, str]
"""Name of a receptacle, and the body (object handle or ``articulation/link``) that carries it."""

Base = tuple[float, float, float]
"""x [m], y [m], yaw [rad] of the robot's base in the world."""


@dataclass(frozen=True, kw_only=True)
class RobotStart:
    """Where the robot starts: base and arm joints (7,) [rad]."""

    base: Base
    arm_qpos_rad: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Rearrangement:
    """An object that the episode is about: where it starts and where it is to go.

    Attributes:
        object: Its handle.
        start: The receptacle it starts on; None when the robot holds it.
        goal: The receptacle it is to be put on; None when it only has to be picked.
        world_from_goal: Its pose at the goal (the object's frame, settled); None without a goal.
    """

    object: str
    start: ReceptacleRef | None = None
    goal: ReceptacleRef | None = None
    world_from_goal: Pose7 | None = None


@dataclass(frozen=True, kw_only=True)
class HandleRef:
    """A door or drawer to open or close: furniture handle, its joint, and the handle's marker."""

    furniture: str
    joint: str
    marker: str


@dataclass(frozen=True, kw_only=True)
class NavigationGoal:
    """Where Navigate has to end: a start pose of the skill `skill` (an env id)."""

    skill: str
    base: Base


@dataclass(frozen=True, kw_only=True)
class Episode:
    """One start state and what is to be done.

    Attributes:
        id: Unique within its set, e.g. ``HabPick-v1/replicaCAD/train/0/00007``.
        seed: Seeds whatever the agent or environment draws during the episode.
        objects: Object handle (``003_cracker_box_:0001``) -> start pose of every movable object
            that takes part.
        joints: Furniture handle -> joint name -> position [m or rad]; the others start at zero.
        loose: Handle -> settled pose of the layout's own loose objects; one dict for all episodes
            of a layout, and stored once in a file.
        targets: The objects to rearrange, in the task's order.
        held: Handle of the object that starts in the grasp.
        handle: The door or drawer that the skill is about.
        navigation: The goal of Navigate.
        habitat: What the Habitat file that the episode was read from holds beyond all this;
            `hab_tasks.episodes.habitat` keeps and writes it.
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
        """Handle of the first object to rearrange, empty when there is none."""
        return self.targets[0].object if self.targets else ""


@dataclass(frozen=True, kw_only=True)
class EpisodeSet:
    """A list of episodes and what it was made from.

    Attributes:
        rejections: Reason -> how many candidates were refused while generating.
        habitat: What a Habitat file holds beside its episodes.
    """

    env: str
    scene_dataset: str
    split: str
    seed: int
    episodes: tuple[Episode, ...]
    rejections: dict[str, int] = field(default_factory=dict)
    habitat: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.episodes)


def template_of(handle: str) -> str:
    """Returns the template's name in a handle: ``003_cracker_box_:0001`` -> ``003_cracker_box``."""
    return handle.rsplit("_:", 1)[0]


def rounded(world_from_object: Pose7) -> Pose7:
    """Returns a pose as files keep it, to `POSE_DIGITS`."""
    return tuple(round(x, POSE_DIGITS) + 0.0 for x in world_from_object)  # type: ignore[return-value]


def write_episodes(episodes: EpisodeSet, file: Path) -> None:
    """Writes an episode file aside and renames it."""
    raw = {"schema": SCHEMA, **asdict(episodes)}
    raw["scenes"] = {entry["scene_id"]: entry.pop("loose") for entry in raw["episodes"]}
    for entry in (raw, *raw["episodes"]):
        if not entry["habitat"]:
            del entry["habitat"]
    save_json(raw, file, sort_keys=True)


def save_json(value: Any, file: Path, *, sort_keys: bool) -> None:
    """Writes a ``.json`` or ``.json.gz`` file aside and renames it."""
    data = (json.dumps(value, sort_keys=sort_keys) + "\n").encode()
    if file.suffix == ".gz":
        data = gzip.compress(data, mtime=0)
    with written_aside(file) as scratch:
        scratch.write_bytes(data)


def read_episodes(file: Path) -> EpisodeSet:
    """Reads an episode file.

    Raises:
        EpisodeError: Absent, damaged, of another schema version, or with a missing or odd field.
    """
    raw = load_json(file)
    version = raw.get("schema") if isinstance(raw, dict) else None
    if version != SCHEMA:
        raise EpisodeError(
            f"{file}: episode schema {version!r}; this version reads {SCHEMA}. "
            "Make it anew with `hab-tasks episodes`."
        )
    where = str(file)
    with naming(where, "scenes"):
        scenes = {s: {k: read_pose(p) for k, p in v.items()} for s, v in raw["scenes"].items()}
    with naming(where, "episodes"):
        entries = list(enumerate(raw["episodes"]))
    with naming(where, "env, scene_dataset, split, seed, rejections"):
        return EpisodeSet(
            env=str(raw["env"]),
            scene_dataset=str(raw["scene_dataset"]),
            split=str(raw["split"]),
            seed=int(raw["seed"]),
            episodes=tuple(
                read_episode(entry, scenes, f"{where}: episode {_id(entry, index)!r}")
                for index, entry in entries
            ),
            rejections={str(k): int(v) for k, v in raw.get("rejections", {}).items()},
            habitat=dict(raw.get("habitat", {})),
        )


@contextmanager
def naming(where: str, name: str) -> Iterator[None]:
    """Names the episode and the field when something in it is missing, odd or unknown."""
    try:
        yield
    except KeyError as error:
        raise EpisodeError(f"{where}, field {name}: {error} is missing.") from error
    except UnknownNameError as error:
        raise EpisodeError(f"{where}, field {name}: {error}") from error
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise EpisodeError(f"{where}, field {name}: malformed ({error}).") from error


def load_json(file: Path) -> Any:
    """Returns what a ``.json`` or ``.json.gz`` file holds.

    Raises:
        EpisodeError: Absent or damaged.
    """
    try:
        data = file.read_bytes()
        return json.loads(gzip.decompress(data) if file.suffix == ".gz" else data)
    except FileNotFoundError as error:
        raise EpisodeError(f"{file}: no such file.") from error
    except (OSError, EOFError, ValueError, zlib.error) as error:
        raise EpisodeError(f"{file}: not a valid episode file ({error}).") from error


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
        scene_id = str(entry["scene_id"])
        loose = scenes[scene_id]
    with naming(where, "robot"):
        robot = _robot(entry["robot"])
    with naming(where, "objects"):
        objects = {str(k): read_pose(v) for k, v in entry["objects"].items()}
    with naming(where, "targets"):
        targets = tuple(_rearrangement(target, objects) for target in entry["targets"])
    with naming(where, "held"):
        held = None if entry.get("held") is None else _among(entry["held"], objects)
    with naming(where, "handle"):
        handle = entry.get("handle")
        handle = HandleRef(**{k: str(v) for k, v in handle.items()}) if handle else None
    with naming(where, "navigation"):
        goal = entry.get("navigation")
        goal = NavigationGoal(skill=str(goal["skill"]), base=_base(goal["base"])) if goal else None
    with naming(where, "joints"):
        joints = {
            str(k): {str(j): finite(q) for j, q in v.items()} for k, v in entry["joints"].items()
        }
    with naming(where, "id, seed, habitat"):
        return Episode(
            id=str(entry["id"]),
            scene_id=scene_id,
            seed=int(entry["seed"]),
            robot=robot,
            objects=objects,
            targets=targets,
            held=held,
            handle=handle,
            navigation=goal,
            joints=joints,
            loose=loose,
            habitat=dict(entry.get("habitat", {})),
        )


def _id(entry: Any, index: int) -> Any:
    return entry.get("id", index) if isinstance(entry, dict) else index


def _among(handle: Any, objects: dict[str, Pose7]) -> str:
    if handle not in objects:
        raise ValueError(f"{handle!r} is not among the objects")
    return str(handle)


def _robot(entry: dict[str, Any]) -> RobotStart:
    arm = tuple(finite(x) for x in entry["arm_qpos_rad"])
    if len(arm) != ARM_JOINT_COUNT:
        raise ValueError(f"arm_qpos_rad with {len(arm)} joints instead of {ARM_JOINT_COUNT}")
    return RobotStart(base=_base(entry["base"]), arm_qpos_rad=arm)


def _rearrangement(entry: dict[str, Any], objects: dict[str, Pose7]) -> Rearrangement:
    start, goal, pose = entry.get("start"), entry.get("goal"), entry.get("world_from_goal")
    return Rearrangement(
        object=_among(entry["object"], objects),
        start=_receptacle(start) if start else None,
        goal=_receptacle(goal) if goal else None,
        world_from_goal=read_pose(pose) if pose else None,
    )


def _receptacle(values: Any) -> ReceptacleRef:
    name, body = values
    return str(name), str(body)


def _base(values: Any) -> Base:
    x, y, yaw = (finite(value) for value in values)
    return x, y, yaw


def read_pose(values: Any) -> Pose7:
    """Returns a pose as files hold it. Raises TypeError or ValueError for anything else."""
    numbers = tuple(finite(x) for x in values)
    if len(numbers) != 7:
        raise ValueError(f"a pose needs 7 numbers, found {len(numbers)}")
    if not math.hypot(*numbers[3:]) > 0:
        raise ValueError("a pose whose quaternion is zero")
    return numbers  # type: ignore[return-value]


def finite(value: Any) -> float:
    """Returns a number. Raises TypeError or ValueError when it is none, or not finite."""
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{value!r} is not a finite number")
    return number
