"""Data model of an episode: layout, object poses, robot start and goals; provenance; requests.

Files are JSON (``.json`` or ``.json.gz``): ``{"schema": 4, "env", "scene_dataset", "made_from",
"split", "seed", "scenes": {scene_id: {object name: pose}}, "episodes": [...]}``. Poses are
position [m] and quaternion wxyz in the z-up world. An episode always gives the same start state.
"""

from __future__ import annotations

import gzip
import json
import logging
import math
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from hab_tasks import option_values
from hab_tasks.errors import EpisodeError, OptionError
from hab_tasks.geometry import Array, Pose7
from hab_tasks.io.files import written_aside
from hab_tasks.robots import DEFAULT_ROBOT
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.typed_values import read_value
from hab_tasks.world.scenes.habitat.dataset import SceneDataset, embedded_dataset
from hab_tasks.world.scenes.spec import ObjectTemplate

logger = logging.getLogger(__name__)


def _can_turn(pose: Pose7) -> str:
    size = math.hypot(*pose[3:])
    return "" if 0 < size < math.inf else "a pose whose quaternion is neither zero nor too large"


Pose = Annotated[Pose7, _can_turn]

LARGEST_BYTES = 256 * 2**20
"""Maximum uncompressed size of an episode file: some hundred thousand episodes."""


def load_json(file: Path) -> Any:
    """Returns the content of a ``.json`` or ``.json.gz`` file.

    Raises:
        EpisodeError: Absent, not a regular file, too large, or damaged.
    """
    try:
        if file.exists() and not file.is_file():
            raise EpisodeError(f"{file}: not a regular file.")
        with gzip.open(file) if file.suffix == ".gz" else file.open("rb") as stream:
            data = stream.read(LARGEST_BYTES + 1)
        if len(data) > LARGEST_BYTES:
            raise EpisodeError(f"{file}: more than {LARGEST_BYTES // 2**20} MiB of JSON.")
        return json.loads(data)
    except FileNotFoundError as error:
        raise EpisodeError(f"{file}: no such file.") from error
    except RecursionError as error:
        raise EpisodeError(f"{file}: not a valid episode file (nested too deeply).") from error
    except (OSError, EOFError, ValueError, zlib.error) as error:
        raise EpisodeError(f"{file}: not a valid episode file ({error}).") from error


EMBEDDED, YCB = "embedded", "ycb"


def _is_digest(value: str) -> str:
    return "" if len(value) == 8 else "8 hexadecimal digits"


def _is_kind(value: str) -> str:
    return "" if value in (EMBEDDED, YCB) else f"{EMBEDDED} or {YCB}"


Digest = Annotated[str, _is_digest]


@dataclass(frozen=True, kw_only=True)
class MadeFrom:
    """Provenance of a set of episodes.

    Attributes:
        dataset: The scene dataset's fingerprint, 8 hexadecimal digits.
        objects: The movable objects, `EMBEDDED` or `YCB`.
        masses: Fingerprint of the objects' names and masses.
        generator: Version of the generator; None for episodes from other sources.
    """

    dataset: Digest
    objects: Annotated[str, _is_kind]
    masses: Digest
    generator: int | None


SCHEMA = 4
POSE_DIGITS = 6
"""Poses are rounded to a micrometre, in memory and in files, so that both give the same start."""

ReceptacleRef = tuple[str, str]
"""Name of a receptacle, and the body (object name or ``articulation/link``) that carries it."""

Base = tuple[float, float, float]
"""x [m], y [m], yaw [rad] of the robot's base in the world."""


@dataclass(frozen=True, kw_only=True)
class RobotStart:
    """Start state of the robot: base, and joint name -> position of its `arm_joints`."""

    base: Base
    arm_qpos_rad: dict[str, float]

    @classmethod
    def of(cls, robot: RobotSpec, base: Base, arm_rad: Iterable[float]) -> RobotStart:
        """Returns a start with an arm pose (J,) [rad] in the order of the robot's joints."""
        joints = zip(robot.arm_joints, map(float, arm_rad), strict=True)
        return cls(base=base, arm_qpos_rad=dict(joints))

    def arm_pose(self, robot: RobotSpec) -> Array:
        """Returns the arm pose (J,) [rad] in the order of the robot's joints."""
        return np.array([self.arm_qpos_rad[name] for name in robot.arm_joints])


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
    world_from_goal: Pose | None = None


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
    objects: dict[str, Pose]
    targets: tuple[Rearrangement, ...] = ()
    held: str | None = None
    handle: HandleRef | None = None
    navigation: NavigationGoal | None = None
    joints: dict[str, dict[str, float]] = field(default_factory=dict)
    loose: dict[str, Pose] = field(default_factory=dict)
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
        robot: ManiSkill's uid of the robot that starts there.
        habitat: Further data of a Habitat file, beside its episodes.
    """

    env: str
    scene_dataset: str
    split: str
    seed: int
    made_from: MadeFrom
    episodes: tuple[Episode, ...]
    rejections: dict[str, int] = field(default_factory=dict)
    robot: str = DEFAULT_ROBOT.uid
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
    if episodes.robot == DEFAULT_ROBOT.uid:
        del raw["robot"]
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


def read_episodes(file: Path, env_id: str | None = None, robot: str | None = None) -> EpisodeSet:
    """Reads an episode file; with `env_id` and `robot`, one for these.

    Raises:
        EpisodeError: Absent, damaged, of another schema version, with an invalid field, or of
            another environment or robot.
    """
    raw = load_json(file)
    version = raw.pop("schema", None) if isinstance(raw, dict) else None
    if version != SCHEMA:
        raise EpisodeError(
            f"{file}: episode schema {version!r}; this version reads {SCHEMA}. "
            "Generate it again with `hab-tasks episodes`."
        )
    scenes = read_value(
        dict[str, dict[str, Pose]], raw.pop("scenes", None), f"{file}: scenes", EpisodeError
    )
    found = read_value(EpisodeSet, raw, str(file), EpisodeError)
    counts = Counter(episode.id for episode in found.episodes)
    twice = [name for name, count in counts.items() if count > 1]
    if twice:
        raise EpisodeError(f"{file}: episode {twice[0]!r} appears twice.")
    if env_id not in (None, found.env):
        raise EpisodeError(f"{file}: made for {found.env}, not for {env_id}.")
    if robot not in (None, found.robot):
        raise EpisodeError(f"{file}: made for the robot {found.robot}, not for {robot}.")
    if env_id is not None and not found.episodes:
        raise EpisodeError(f"{file}: contains no episodes.")
    whole = tuple(with_loose(e, scenes, f"{file}: episode {e.id!r}") for e in found.episodes)
    return replace(found, episodes=whole)


def with_loose(episode: Episode, scenes: Mapping[str, dict[str, Pose7]], where: str) -> Episode:
    """Returns an episode that was read from JSON with the loose objects of its layout.

    Raises:
        EpisodeError: The layout is not among the scenes, or an object not among the episode's.
    """
    if episode.scene_id not in scenes:
        raise EpisodeError(f"{where}: scene_id {episode.scene_id!r} is not among the scenes.")
    held = () if episode.held is None else (episode.held,)
    for name in (*(target.object for target in episode.targets), *held):
        if name not in episode.objects:
            raise EpisodeError(f"{where}: {name!r} is not among the objects.")
    return replace(episode, loose=scenes[episode.scene_id])


@dataclass(frozen=True, kw_only=True)
class EpisodeRequest:
    """A request for episodes.

    Attributes:
        env_id: Their environment.
        scene_dataset: ``apartment``, ``replica_cad``, or the path of a ReplicaCAD folder.
        objects: Path of a YCB folder; None for the embedded objects.
        split: ``train``, ``val`` or ``test``; None picks the least-seen split available.
        scene: Restrict episodes to this layout.
        file: An episode file instead of generated episodes.
        seed: Seed of the generated episodes.
        novel: ``objects`` or ``receptacles``: use those held out for evaluation (S E.1); None for
            the training objects and the skill's own receptacles.
        robot: ManiSkill's uid of the robot.
        clutter: Number of objects that are added to generated episodes, where there is room.
    """

    env_id: str
    scene_dataset: str | Path = "apartment"
    objects: str | Path | None = None
    split: str | None = None
    scene: str | None = None
    file: str | Path | None = None
    seed: int = 0
    novel: str | None = None
    robot: str = DEFAULT_ROBOT.uid
    clutter: int = 0

    def __post_init__(self) -> None:
        """Rejects values of a wrong type."""
        option_values.whole("seed", self.seed, 0, option_values.LARGEST_SEED)
        for option in ("split", "scene", "novel"):
            option_values.name(option, getattr(self, option))
        for option in ("scene_dataset", "objects", "file"):
            option_values.path(option, getattr(self, option))
        if self.scene_dataset is None:
            raise OptionError.of_value("scene_dataset", None, "a path or a name")


def stable_hash(*names: str) -> int:
    """Returns a hash of names that is equal on every machine and in every run."""
    return zlib.crc32("\0".join(names).encode())


def made_from(
    dataset: SceneDataset, objects: Mapping[str, ObjectTemplate], generator: int | None = None
) -> MadeFrom:
    """Returns the provenance of episodes in `dataset` with `objects` (name -> template)."""
    files = (template.visual_file for template in objects.values())
    ours = embedded_dataset().resolve()
    embedded = all(file is not None and file.is_relative_to(ours) for file in files)
    masses = (f"{name} {template.mass_kg}" for name, template in sorted(objects.items()))
    return MadeFrom(
        dataset=f"{dataset.fingerprint:08x}",
        objects=EMBEDDED if embedded else YCB,
        masses=f"{stable_hash(*masses):08x}",
        generator=generator,
    )


def check_made_from(where: str, name: str, given: MadeFrom, now: MadeFrom) -> None:
    """Rejects episodes with other objects; warns if objects or scene dataset have changed.

    `where` is the source of the episodes for messages, `name` their scene dataset and `given` their
    provenance; `now` is that of episodes generated with the same dataset.

    Raises:
        EpisodeError: The objects are of another kind.
    """
    if given.objects != now.objects:
        wanted = "the path of the YCB folder" if given.objects == YCB else "nothing"
        raise EpisodeError(
            f"{where}: made with the {given.objects} objects, and these are the {now.objects} "
            f"ones. Give {wanted} for the objects (--objects, objects=)."
        )
    changed = [
        what
        for what, before, after in (
            (f"the scene dataset {name}", given.dataset, now.dataset),
            (f"the {now.objects} objects", given.masses, now.masses),
        )
        if before != after
    ]
    if changed:
        logger.warning(
            "%s: %s changed since these episodes were made; they may not start as they did then.",
            where,
            " and ".join(changed) + (" have" if len(changed) > 1 else " has"),
        )
