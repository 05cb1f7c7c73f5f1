"""Metadata of a LeRobot dataset (v3.0).

meta/info.json              features with shapes and names, frame rate, paths
meta/stats.json             minimum, maximum, mean and standard deviation of each feature
meta/tasks.parquet          instruction -> task_index
meta/episodes/...parquet    length, task, files and statistics of each episode
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import parquet

from hab_spa.recording.dataset_stats import Stats, merge_stats, nested
from hab_tasks.constants import CONTROL_HZ

VERSION = "v3.0"
PLACE = "chunk-{chunk_index:03d}/file-{file_index:03d}"
DATA_PATH, EPISODES_PATH = f"data/{PLACE}.parquet", f"meta/episodes/{PLACE}.parquet"
VIDEO_PATH = f"videos/VIDEO/{PLACE}.mp4"
FILES_OF_A_CHUNK = 1000
FILE_SIZE_MB = 100
"""Size at which a new data file is started."""


@dataclass(frozen=True, kw_only=True)
class Feature:
    """One column: `shape` of a frame's value, and the names of its entries."""

    dtype: str
    shape: tuple[int, ...]
    names: tuple[str, ...] | None = None

    def described(self) -> dict[str, Any]:
        """Returns the entry of `info.json`."""
        found: dict[str, Any] = {"dtype": self.dtype, "shape": self.shape, "names": self.names}
        if self.dtype == "image":
            found["info"] = {"is_depth_map": True, "depth_unit": "mm"}
        if self.dtype == "video":
            height, width, channels = self.shape
            found["info"] = {
                "video.height": height,
                "video.width": width,
                "video.channels": channels,
                "video.codec": "h264",
                "video.pix_fmt": "yuv444p" if height % 2 or width % 2 else "yuv420p",
                "video.fps": CONTROL_HZ,
                "video.is_depth_map": False,
                "has_audio": False,
            }
        return found


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


def numbered(path: str, file: int) -> str:
    """Returns the path of a file by its number."""
    chunk, number = divmod(file, FILES_OF_A_CHUNK)
    return path.format(chunk_index=chunk, file_index=number)


def write_meta(
    folder: Path,
    features: Mapping[str, Feature],
    tasks: list[str],
    entries: list[EpisodeEntry],
    robot: str,
) -> None:
    """Writes everything under `meta`."""
    episodes = folder / numbered(EPISODES_PATH, 0)
    episodes.parent.mkdir(parents=True)
    videos = [name for name, feature in features.items() if feature.dtype == "video"]
    rows = [_episode_row(number, entry, videos) for number, entry in enumerate(entries)]
    parquet.write_table(pa.Table.from_pylist(rows), episodes)
    parquet.write_table(_task_table(tasks), folder / "meta" / "tasks.parquet")
    names = entries[0].stats
    stats = {name: merge_stats([entry.stats[name] for entry in entries]) for name in names}
    _write_json(folder / "meta" / "stats.json", {name: nested(s) for name, s in stats.items()})
    info = {
        "codebase_version": VERSION,
        "robot_type": robot,
        "total_episodes": len(entries),
        "total_frames": sum(entry.length for entry in entries),
        "total_tasks": len(tasks),
        "chunks_size": FILES_OF_A_CHUNK,
        "data_files_size_in_mb": FILE_SIZE_MB,
        "video_files_size_in_mb": FILE_SIZE_MB,
        "fps": CONTROL_HZ,
        "splits": {"train": f"0:{len(entries)}"},
        "data_path": DATA_PATH,
        "video_path": VIDEO_PATH.replace("VIDEO", "{video_key}") if videos else None,
        "features": {name: feature.described() for name, feature in features.items()},
    }
    _write_json(folder / "meta" / "info.json", info)


def _episode_row(number: int, entry: EpisodeEntry, videos: list[str]) -> dict[str, Any]:
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
    chunk, file = divmod(number, FILES_OF_A_CHUNK)
    for name in videos:
        row |= {
            f"videos/{name}/chunk_index": chunk,
            f"videos/{name}/file_index": file,
            f"videos/{name}/from_timestamp": 0.0,
            f"videos/{name}/to_timestamp": entry.length / CONTROL_HZ,
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
