"""Writes a recorded trajectory as a LeRobot dataset (v3.0), for imitation learning.

The package `lerobot` requires an older PyTorch than this project. The format consists of Parquet,
JSON and video files, so pyarrow (the extra `lerobot` of this package) is sufficient.

    data/...parquet             one row per action: observation before it, reward after it
    videos/CAMERA/...mp4        colour images, one file per episode
    meta/                       see `hab_spa.recording.lerobot_meta`

``observation.state`` is proprioception; positions of targets are ``observation.environment_state``.
Depth is embedded as PNG of 16 bits, in millimetres. ``subtask`` is the instruction of the stage.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from hab_spa.recording.dataset_stats import stats_of
from hab_spa.recording.frames import DEPTH, VIDEO, Seen
from hab_tasks.constants import CONTROL_HZ
from hab_tasks.errors import OptionError
from hab_tasks.robots.control import control_configs
from hab_tasks.robots.spec import RobotSpec

try:
    import pyarrow as pa
    from pyarrow import parquet
except ImportError as error:
    raise OptionError("--lerobot needs pyarrow: pip install 'hab-spa[lerobot]'.") from error

from hab_spa.recording.lerobot_meta import (
    DATA_PATH,
    FILE_SIZE_MB,
    VIDEO_PATH,
    EpisodeEntry,
    Feature,
    numbered,
    write_meta,
)

IMAGE = pa.struct({"bytes": pa.binary(), "path": pa.string()})
SINGLE = {"float32": pa.float32(), "int64": pa.int64(), "bool": pa.bool_(), "string": pa.string()}

STATE, TARGETS = "observation.state", "observation.environment_state"
FEATURES = {"agent": STATE, "extra": TARGETS}
"""Group of an observation -> feature."""

Frames = dict[str, NDArray[Any]]
"""Feature -> values in all frames of an episode, (T, n)."""


@dataclass(frozen=True, kw_only=True)
class _Numbers:
    """Values of an episode by feature, with the descriptions of the features."""

    frames: Frames
    features: dict[str, Feature]

    def drop(self, name: str) -> None:
        """Removes a feature, if it is there."""
        self.frames.pop(name, None)
        self.features.pop(name, None)


def write_dataset(
    trajectory: Path, folder: Path, robot: RobotSpec, seen: Sequence[Seen], targets: bool = True
) -> None:
    """Writes a dataset.

    Args:
        trajectory: The .h5 file of a recording, with its .json and the folders of images beside it;
            videos are moved into the dataset.
        folder: Output folder; it is created.
        robot: The robot.
        seen: What was seen and told in each episode.
        targets: Whether to write the positions of targets.
    """
    recording = json.loads(trajectory.with_suffix(".json").read_text(encoding="utf-8"))
    features: dict[str, Feature] = {}
    entries: list[EpisodeEntry] = []
    tasks = list(dict.fromkeys(one.task for one in seen))
    with h5py.File(trajectory) as file, _DataFiles(folder) as data:
        for number, (entry, one) in enumerate(zip(recording["episodes"], seen, strict=True)):
            name = f"traj_{entry['episode_id']}"
            found = _numbers(file[name], one, action_names(robot, entry["control_mode"]))
            if not targets:
                found.drop(TARGETS)
            start = entries[-1].start + entries[-1].length if entries else 0
            length = len(found.frames["action"])
            found.frames.update(_indices(length, number, start, tasks.index(one.task)))
            pictures = {f"observation.images.{n}": shape for n, shape in one.shapes.items()}
            features = found.features | _index_features(found.frames)
            features |= {n: _image_feature(shape) for n, shape in pictures.items()}
            columns = {n: _column(v, features[n]) for n, v in found.frames.items()}
            columns |= _take_images(trajectory.with_name(name), folder, number)
            stats = {n: stats_of(v) for n, v in found.frames.items() if v.dtype != object}
            stats |= {f"observation.images.{n}": s for n, s in one.stats.items()}
            entries.append(
                EpisodeEntry(
                    task=one.task,
                    start=start,
                    length=length,
                    file=data.write(pa.table(columns)),
                    stats=stats,
                )
            )
    write_meta(folder, features, tasks, entries, robot.uid)


def action_names(robot: RobotSpec, control_mode: str) -> tuple[str, ...]:
    """Returns the names of the entries of a control mode's action."""
    config = control_configs(robot)[control_mode]
    if config.base == "discrete":
        return ("cell",)
    arm = {"still": (), "ee": ("ee_x", "ee_y", "ee_z", "gripper")}
    base = {"still": (), "velocity": ("forward", "turn"), "pose": ("base_x", "base_y", "base_yaw")}
    return (*arm.get(config.arm, (*robot.arm_joints, "gripper")), *base[config.base])


class _DataFiles:
    """Writes tables to a sequence of files of limited size, a row group for each."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._number, self._writer = folder, -1, None
        self._path = folder

    def __enter__(self) -> _DataFiles:
        return self

    def __exit__(self, *_: object) -> None:
        if self._writer is not None:
            self._writer.close()

    def write(self, table: pa.Table) -> int:
        """Appends a table; returns the number of the file that it went into."""
        if self._writer is not None and self._path.stat().st_size > FILE_SIZE_MB * 1e6:
            self._writer.close()
            self._writer = None
        if self._writer is None:
            self._number += 1
            self._path = self._folder / numbered(DATA_PATH, self._number)
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = parquet.ParquetWriter(self._path, table.schema)
        self._writer.write_table(table)
        return self._number


def _numbers(group: Any, seen: Seen, actions_are: tuple[str, ...]) -> _Numbers:
    """Returns an episode's observed numbers, actions, rewards, flags and stages."""
    actions = np.asarray(group["actions"], dtype=np.float32)
    count = len(actions)
    frames: Frames = {}
    features: dict[str, Feature] = {}
    for feature, parts in _observed(group["obs"], seen):
        columns = [np.reshape(values[:count], (count, -1)) for _, values in parts]
        frames[feature] = np.concatenate(columns, axis=1).astype(np.float32)
        names = tuple(
            f"{name}_{i}"
            for (name, _), v in zip(parts, columns, strict=True)
            for i in range(v.shape[1])
        )
        features[feature] = Feature(dtype="float32", shape=(len(names),), names=names)
    done = np.asarray(group["terminated"]) | np.asarray(group["truncated"])
    frames |= {
        "action": actions.reshape(count, -1),
        "next.reward": np.asarray(group["rewards"], dtype=np.float32)[:, None],
        "next.done": done[:, None],
        "next.success": np.asarray(group["success"])[:, None],
        "subtask": _stage_texts(seen, count)[:, None],
    }
    features["action"] = Feature(
        dtype="float32", shape=frames["action"].shape[1:], names=actions_are
    )
    for name in ("next.reward", "next.done", "next.success"):
        features[name] = Feature(dtype=str(frames[name].dtype), shape=(1,))
    features["subtask"] = Feature(dtype="string", shape=(1,))
    return _Numbers(frames=frames, features=features)


def _observed(observed: Any, seen: Seen) -> Iterator[tuple[str, list[tuple[str, Any]]]]:
    """Yields each feature of an observation with name and values (T + 1, ...) of its entries."""
    is_flat = isinstance(observed, h5py.Dataset)  # with `obs_mode="state"`
    obs: Any = observed
    for group, feature in FEATURES.items():
        if not is_flat:
            parts = list(obs[group].items()) if group in obs else []
        else:
            ends = np.cumsum([size for _, _, size in seen.entries])
            parts = [
                (name, obs[:, end - size : end])
                for (of, name, size), end in zip(seen.entries, ends, strict=True)
                if of == group
            ]
        if parts:
            yield feature, parts


def _stage_texts(seen: Seen, count: int) -> NDArray[Any]:
    """Returns the instruction of the stage in every frame, (T,) of text."""
    ends = [step for step, _ in seen.stages[1:]] + [count]
    texts = [[text] * (end - step) for (step, text), end in zip(seen.stages, ends, strict=True)]
    return np.array([text for part in texts for text in part], dtype=object)


def _take_images(images: Path, folder: Path, number: int) -> dict[str, pa.Array]:
    """Returns an episode's embedded images by feature; moves its videos into the dataset."""
    columns = {}
    for file in sorted(images.iterdir()):
        feature = f"observation.images.{file.stem}"
        if file.suffix == VIDEO:
            target = folder / numbered(VIDEO_PATH, number).replace("VIDEO", feature)
            target.parent.mkdir(parents=True, exist_ok=True)
            file.replace(target)
        elif file.suffix == DEPTH:
            with zipfile.ZipFile(file) as pngs:
                rows = [{"bytes": pngs.read(name), "path": None} for name in pngs.namelist()]
            columns[feature] = pa.array(rows, type=IMAGE)
    return columns


def _indices(count: int, episode: int, start: int, task: int) -> Frames:
    """Returns timestamps [s] and LeRobot's frame indices, each (T, 1)."""
    frame = np.arange(count)[:, None]
    return {
        "timestamp": (frame / CONTROL_HZ).astype(np.float32),
        "frame_index": frame,
        "episode_index": np.full_like(frame, episode),
        "index": start + frame,
        "task_index": np.full_like(frame, task),
    }


def _index_features(frames: Frames) -> dict[str, Feature]:
    names = ("timestamp", "frame_index", "episode_index", "index", "task_index")
    return {name: Feature(dtype=str(frames[name].dtype), shape=(1,)) for name in names}


def _image_feature(shape: tuple[int, ...]) -> Feature:
    is_depth = shape[2] == 1
    dtype = "image" if is_depth else "video"
    return Feature(dtype=dtype, shape=shape, names=("height", "width", "channels"))


def _column(values: NDArray[Any], feature: Feature) -> pa.Array:
    single = SINGLE[feature.dtype]
    if feature.shape == (1,):
        return pa.array(values[:, 0], type=single)
    return pa.FixedSizeListArray.from_arrays(
        values.reshape(-1), type=pa.list_(single, feature.shape[0])
    )
