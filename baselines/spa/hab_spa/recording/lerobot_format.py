"""Writes a recorded trajectory as a LeRobot dataset (v3.0), for imitation learning.

The package `lerobot` requires an older PyTorch than this project. The format consists of Parquet
and JSON files, so pyarrow (the extra `lerobot` of this package) is sufficient.

    meta/info.json              features with shapes and names, frame rate, paths
    meta/stats.json             minimum, maximum, mean and standard deviation of each feature
    meta/tasks.parquet          instruction -> task_index
    meta/episodes/...parquet    length, task and statistics of each episode
    data/...parquet             one row per action: observation before it, reward after it

Images are embedded as PNG; depth as grayscale, where 255 is the cameras' range (10 m).
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from hab_spa.recording.dataset_stats import Stats, merge_stats, nested, stats_of
from hab_tasks.constants import CONTROL_HZ
from hab_tasks.errors import OptionError
from hab_tasks.robots.control import control_configs
from hab_tasks.robots.spec import RobotSpec

try:
    import pyarrow as pa
    from pyarrow import parquet
except ImportError as error:
    raise OptionError("--lerobot needs pyarrow: pip install 'hab-spa[lerobot]'.") from error

VERSION = "v3.0"
PATH = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
DATA_PATH, EPISODES_PATH = f"data/{PATH}", f"meta/episodes/{PATH}"
FILES_OF_A_CHUNK = 1000
FILE_SIZE_MB = 100
"""Size at which a new data file is started."""

IMAGE = pa.struct({"bytes": pa.binary(), "path": pa.string()})
NUMBERS = {"float32": pa.float32(), "int64": pa.int64(), "bool": pa.bool_()}

Frames = dict[str, NDArray[Any]]
"""Feature -> values in all frames of an episode, (T, ...)."""


@dataclass(frozen=True, kw_only=True)
class Feature:
    """One column: `shape` of a frame's value, and the names of its entries."""

    dtype: str
    shape: tuple[int, ...]
    names: tuple[str, ...] | None = None

    @property
    def column(self) -> pa.DataType:
        """The Parquet type."""
        if self.dtype == "image":
            return IMAGE
        single = NUMBERS[self.dtype]
        return single if self.shape == (1,) else pa.list_(single, self.shape[0])


@dataclass(frozen=True, kw_only=True)
class EpisodeEntry:
    """Metadata of a written episode.

    Attributes:
        task: Instruction.
        start: Index of its first frame in the dataset.
        length: Number of frames.
        file: Index of its data file.
        stats: Feature -> statistics.
    """

    task: str
    start: int
    length: int
    file: int
    stats: Mapping[str, Stats]


def write_dataset(trajectory: Path, folder: Path, robot: RobotSpec) -> None:
    """Writes a dataset.

    Args:
        trajectory: The .h5 file of a recording, with its .json beside it.
        folder: Output folder; it is created.
        robot: The robot.
    """
    recording = json.loads(trajectory.with_suffix(".json").read_text(encoding="utf-8"))
    features: dict[str, Feature] = {}
    entries: list[EpisodeEntry] = []
    tasks = list(dict.fromkeys(entry["task"] for entry in recording["episodes"]))
    with h5py.File(trajectory) as file, _DataFiles(folder) as data:
        for number, entry in enumerate(recording["episodes"]):
            group: Any = file[f"traj_{entry['episode_id']}"]
            frames, features = _frames(group, action_names(robot, entry["control_mode"]))
            start = entries[-1].start + entries[-1].length if entries else 0
            frames |= _indices(len(frames["action"]), number, start, tasks.index(entry["task"]))
            features |= _index_features(frames)
            columns = [_column(frames[name], feature) for name, feature in features.items()]
            into = data.write(pa.Table.from_arrays(columns, names=list(features)))
            entries.append(
                EpisodeEntry(
                    task=entry["task"],
                    start=start,
                    length=len(frames["action"]),
                    file=into,
                    stats={name: stats_of(frames[name]) for name in features},
                )
            )
    _write_meta(folder, features, tasks, entries, robot.uid)


def action_names(robot: RobotSpec, control_mode: str) -> tuple[str, ...]:
    """Returns the names of the entries of a control mode's action."""
    config = control_configs(robot)[control_mode]
    if config.base == "discrete":
        return ("cell",)
    arm = {"still": (), "ee": ("ee_x", "ee_y", "ee_z", "gripper")}
    base = {"still": (), "velocity": ("forward", "turn"), "pose": ("base_x", "base_y", "base_yaw")}
    return (*arm.get(config.arm, (*robot.arm_joints, "gripper")), *base[config.base])


class _DataFiles:
    """Writes tables to a sequence of files of limited size."""

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
            self._path = self._folder / _numbered(DATA_PATH, self._number)
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = parquet.ParquetWriter(self._path, table.schema)
        self._writer.write_table(table)
        return self._number


def _frames(group: Any, actions_are: tuple[str, ...]) -> tuple[Frames, dict[str, Feature]]:
    """Returns the frames of an episode's group: observations, actions, rewards and flags."""
    actions = np.asarray(group["actions"], dtype=np.float32)
    count = len(actions)
    obs = group["obs"]
    seen = list(_numbers_in(obs)) if isinstance(obs, h5py.Group) else [("state", obs)]
    state = np.concatenate([np.reshape(v[:count], (count, -1)) for _, v in seen], axis=1)
    names = tuple(f"{name}_{i}" for name, v in seen for i in range(v[0].size))
    done = np.asarray(group["terminated"]) | np.asarray(group["truncated"])
    frames = {
        "observation.state": state.astype(np.float32),
        "action": actions.reshape(count, -1),
        "next.reward": np.asarray(group["rewards"], dtype=np.float32)[:, None],
        "next.done": done[:, None],
        "next.success": np.asarray(group["success"])[:, None],
    }
    features = {
        name: Feature(dtype=str(values.dtype), shape=values.shape[1:])
        for name, values in frames.items()
    }
    features["observation.state"] = Feature(dtype="float32", shape=state.shape[1:], names=names)
    features["action"] = Feature(
        dtype="float32", shape=frames["action"].shape[1:], names=actions_are
    )
    for name, pictures in _pictures_in(obs):
        frames[name] = pictures[:count]
        shape = pictures.shape[1:]
        features[name] = Feature(dtype="image", shape=shape, names=("height", "width", "channels"))
    return frames, features


def _numbers_in(obs: Any) -> Iterator[tuple[str, Any]]:
    """Yields name and values (T + 1, n) of every non-image entry."""
    for part in ("agent", "extra"):
        if part in obs:
            yield from obs[part].items()


def _pictures_in(obs: Any) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Yields name and images (T + 1, H, W, 3) of every camera."""
    if not isinstance(obs, h5py.Group) or "sensor_data" not in obs:
        return
    cameras: Any = obs["sensor_data"]
    for camera, images in cameras.items():
        if "rgb" in images:
            yield f"observation.images.{camera}", np.asarray(images["rgb"])
        if "depth" in images:
            grey = np.rint(255 * np.clip(images["depth"], 0.0, 1.0)).astype(np.uint8)
            yield f"observation.images.{camera}_depth", np.repeat(grey, 3, axis=-1)


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


def _column(values: NDArray[Any], feature: Feature) -> pa.Array:
    if feature.dtype == "image":
        encoded = [{"bytes": _png(picture), "path": None} for picture in values]
        return pa.array(encoded, type=feature.column)
    if feature.shape == (1,):
        return pa.array(values[:, 0], type=feature.column)
    return pa.FixedSizeListArray.from_arrays(values.reshape(-1), type=feature.column)


def _png(picture: NDArray[np.uint8]) -> bytes:
    file = io.BytesIO()
    Image.fromarray(picture).save(file, format="PNG")
    return file.getvalue()


def _numbered(path: str, file: int) -> str:
    chunk, number = divmod(file, FILES_OF_A_CHUNK)
    return path.format(chunk_index=chunk, file_index=number)


# Metadata --------------------------------------------------------------------------------------


def _write_meta(
    folder: Path,
    features: Mapping[str, Feature],
    tasks: list[str],
    entries: list[EpisodeEntry],
    robot: str,
) -> None:
    """Writes everything under `meta`."""
    episodes = folder / _numbered(EPISODES_PATH, 0)
    episodes.parent.mkdir(parents=True)
    rows = [_episode_row(number, entry) for number, entry in enumerate(entries)]
    parquet.write_table(pa.Table.from_pylist(rows), episodes)
    parquet.write_table(_task_table(tasks), folder / "meta" / "tasks.parquet")
    stats = {name: merge_stats([entry.stats[name] for entry in entries]) for name in features}
    _write_json(folder / "meta" / "stats.json", {name: nested(s) for name, s in stats.items()})
    frames = sum(entry.length for entry in entries)
    info = {
        "codebase_version": VERSION,
        "robot_type": robot,
        "total_episodes": len(entries),
        "total_frames": frames,
        "total_tasks": len(tasks),
        "chunks_size": FILES_OF_A_CHUNK,
        "data_files_size_in_mb": FILE_SIZE_MB,
        "video_files_size_in_mb": FILE_SIZE_MB,
        "fps": CONTROL_HZ,
        "splits": {"train": f"0:{len(entries)}"},
        "data_path": DATA_PATH,
        "video_path": None,
        "features": {
            name: {"dtype": f.dtype, "shape": f.shape, "names": f.names}
            for name, f in features.items()
        },
    }
    _write_json(folder / "meta" / "info.json", info)


def _episode_row(number: int, entry: EpisodeEntry) -> dict[str, Any]:
    """Returns an episode's row: location of its frames, task and statistics."""
    chunk, file = divmod(entry.file, FILES_OF_A_CHUNK)
    row = {
        "episode_index": number,
        "tasks": [entry.task],
        "length": entry.length,
        "data/chunk_index": chunk,
        "data/file_index": file,
        "dataset_from_index": entry.start,
        "dataset_to_index": entry.start + entry.length,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }
    for name, stats in entry.stats.items():
        row |= {f"stats/{name}/{key}": value for key, value in nested(stats).items()}
    return row


def _task_table(tasks: list[str]) -> pa.Table:
    """Returns the tasks as pandas writes a table with the instruction as its index."""
    table = pa.table({"task_index": pa.array(range(len(tasks)), pa.int64()), "task": tasks})
    kinds = {"task_index": "int64", "task": "object"}
    pandas = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [
            {
                "name": name,
                "field_name": name,
                "pandas_type": "int64" if kind == "int64" else "unicode",
                "numpy_type": kind,
                "metadata": None,
            }
            for name, kind in kinds.items()
        ],
        "pandas_version": "2.0.0",
    }
    return table.replace_schema_metadata({"pandas": json.dumps(pandas)})


def _write_json(file: Path, value: object) -> None:
    file.write_text(json.dumps(value, indent=4) + "\n", encoding="utf-8")
