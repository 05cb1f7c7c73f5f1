"""An episode as frozen data: which layout, what lies where, where the robot starts, what to do.

Files are JSON (``.json`` or ``.json.gz``): ``{"schema": 1, "env", "scene_dataset", "split", "seed",
"scenes": {scene_id: {object handle: pose}}, "episodes": [...]}``. Poses are position [m] and
quaternion wxyz in the z-up world. Replaying an episode gives the same start state, always.
"""

from __future__ import annotations

import gzip
import json
import tempfile
import zlib
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from hab_tasks.errors import EpisodeError
from hab_tasks.geometry import Pose7

SCHEMA = 1


@dataclass(frozen=True, kw_only=True)
class RobotStart:
    """Where the robot starts: base (x [m], y [m], yaw [rad]) and arm joints (7,) [rad]."""

    base: tuple[float, float, float]
    arm_qpos_rad: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Episode:
    """One start state and its target.

    Attributes:
        id: Unique within its set, e.g. ``HabPick-v1/replicaCAD/train/0/00007``.
        seed: Seeds whatever the agent or environment draws during the episode.
        objects: Object name -> pose of every movable object that takes part.
        joints: Furniture handle -> joint name -> position [m or rad]; the others start at zero.
        loose: Handle -> settled pose of the layout's own loose objects; one dict for all episodes
            of a layout, and stored once in a file.
        target: The object that the skill is about.
        receptacle: Name of the receptacle the target starts on, and the body that carries it.
    """

    id: str
    scene_id: str
    seed: int
    robot: RobotStart
    objects: dict[str, Pose7]
    target: str
    receptacle: tuple[str, str]
    joints: dict[str, dict[str, float]] = field(default_factory=dict)
    loose: dict[str, Pose7] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class EpisodeSet:
    """A list of episodes and what it was made from.

    Attributes:
        rejections: Reason -> how many candidates were refused while generating.
    """

    env: str
    scene_dataset: str
    split: str
    seed: int
    episodes: tuple[Episode, ...]
    rejections: dict[str, int] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.episodes)


def write_episodes(episodes: EpisodeSet, file: Path) -> None:
    """Writes an episode file aside and renames it."""
    raw = {"schema": SCHEMA, **asdict(episodes)}
    raw["scenes"] = {entry["scene_id"]: entry.pop("loose") for entry in raw["episodes"]}
    data = (json.dumps(raw, sort_keys=True) + "\n").encode()
    if file.suffix == ".gz":
        data = gzip.compress(data, mtime=0)
    file.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=file.parent, prefix=".partial-") as scratch:
        partial = Path(scratch) / file.name
        partial.write_bytes(data)
        partial.replace(file)


def read_episodes(file: Path) -> EpisodeSet:
    """Reads an episode file.

    Raises:
        EpisodeError: Absent, damaged, of another schema version, or with a missing or odd field.
    """
    try:
        data = file.read_bytes()
        raw = json.loads(gzip.decompress(data) if file.suffix == ".gz" else data)
    except FileNotFoundError as error:
        raise EpisodeError(f"{file}: no such file.") from error
    except (OSError, EOFError, ValueError, zlib.error) as error:
        raise EpisodeError(f"{file}: not a valid episode file ({error}).") from error
    version = raw.get("schema") if isinstance(raw, dict) else None
    if version != SCHEMA:
        raise EpisodeError(
            f"{file}: episode schema {version!r}; this version reads {SCHEMA}. "
            "Make it anew with `hab-tasks episodes`."
        )
    try:
        scenes = {s: {k: _pose(p) for k, p in v.items()} for s, v in raw["scenes"].items()}
        return EpisodeSet(
            env=str(raw["env"]),
            scene_dataset=str(raw["scene_dataset"]),
            split=str(raw["split"]),
            seed=int(raw["seed"]),
            episodes=tuple(_episode(entry, scenes) for entry in raw["episodes"]),
            rejections={str(k): int(v) for k, v in raw.get("rejections", {}).items()},
        )
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise EpisodeError(f"{file}: a field is missing or malformed ({error!r}).") from error


def _episode(entry: dict[str, Any], scenes: dict[str, dict[str, Pose7]]) -> Episode:
    base = tuple(float(x) for x in entry["robot"]["base"])
    arm = tuple(float(x) for x in entry["robot"]["arm_qpos_rad"])
    if len(base) != 3 or len(arm) != 7:
        raise ValueError(f"robot start with {len(base)} base and {len(arm)} arm numbers")
    episode = Episode(
        id=str(entry["id"]),
        scene_id=str(entry["scene_id"]),
        seed=int(entry["seed"]),
        robot=RobotStart(base=base, arm_qpos_rad=arm),
        objects={str(k): _pose(v) for k, v in entry["objects"].items()},
        target=str(entry["target"]),
        receptacle=(str(entry["receptacle"][0]), str(entry["receptacle"][1])),
        joints={
            str(k): {str(j): float(q) for j, q in v.items()} for k, v in entry["joints"].items()
        },
        loose=scenes[str(entry["scene_id"])],
    )
    if episode.target not in episode.objects:
        raise ValueError(f"target {episode.target!r} is not among the objects of {episode.id}")
    return episode


def _pose(values: Any) -> Pose7:
    numbers = tuple(float(x) for x in values)
    if len(numbers) != 7:
        raise ValueError(f"a pose needs 7 numbers, found {len(numbers)}")
    return numbers  # type: ignore[return-value]
