"""Copies the first episodes of a recording: LeRobot's dataset and ManiSkill's trajectory."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
from pyarrow import compute, parquet

from hab_spa.recording.dataset_stats import Stats, merge_stats, nested
from hab_spa.recording.lerobot_meta import DATA_PATH, EPISODES_PATH, numbered
from hab_spa.recording.plan import NAME


def copy_dataset(source: Path, target: Path, count: int) -> dict[str, Any]:
    """Copies the first `count` episodes of a LeRobot dataset; returns the new `info.json`."""
    info = json.loads((source / "meta" / "info.json").read_text(encoding="utf-8"))
    table = parquet.read_table(source / numbered(EPISODES_PATH, 0)).slice(0, count)
    episodes = table.to_pylist()
    _copy_frames(source, target, {row["data/file_index"] for row in episodes}, len(episodes))
    for row in episodes:
        for name in info["features"]:
            if f"videos/{name}/file_index" in row:
                place = {k: row[f"videos/{name}/{k}"] for k in ("chunk_index", "file_index")}
                _copy(source, target, info["video_path"].format(video_key=name, **place))
    _copy(source, target, "meta/tasks.parquet")
    _write(target / numbered(EPISODES_PATH, 0), table)
    stats = {
        name: nested(merge_stats([_stats(row, name) for row in episodes]))
        for name in info["features"]
        if f"stats/{name}/mean" in episodes[0]
    }
    _write_json(target / "meta" / "stats.json", stats)
    info["total_episodes"] = len(episodes)
    info["total_frames"] = sum(row["length"] for row in episodes)
    info["splits"] = {"train": f"0:{len(episodes)}"}
    _write_json(target / "meta" / "info.json", info)
    return info


def copy_trajectory(source: Path, target: Path, count: int) -> dict[str, Any]:
    """Copies the first `count` episodes of ManiSkill's two files; returns the description."""
    told = json.loads((source / f"{NAME}.json").read_text(encoding="utf-8"))
    told["episodes"] = told["episodes"][:count]
    target.mkdir(parents=True, exist_ok=True)
    with (
        h5py.File(source / f"{NAME}.h5") as old,
        h5py.File(target / f"{NAME}.h5", "w") as new,
    ):
        for entry in told["episodes"]:
            old.copy(f"traj_{entry['episode_id']}", new)
    _write_json(target / f"{NAME}.json", told)
    return told


def _copy_frames(source: Path, target: Path, files: set[int], count: int) -> None:
    for number in sorted(files):
        table = parquet.read_table(source / numbered(DATA_PATH, number))
        kept = table.filter(compute.field("episode_index") < count)
        _write(target / numbered(DATA_PATH, number), kept)


def _stats(row: Mapping[str, Any], name: str) -> Stats:
    found = {
        field: np.array(row[f"stats/{name}/{key}"], dtype=np.float64)
        for field, key in (
            ("least", "min"),
            ("largest", "max"),
            ("mean", "mean"),
            ("deviation", "std"),
        )
    }
    return Stats(**found, count=row[f"stats/{name}/count"][0])


def _copy(source: Path, target: Path, name: str) -> None:
    (target / name).parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source / name, target / name)


def _write(path: Path, table: pa.Table) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(table, path)


def _write_json(path: Path, value: object) -> None:
    path.write_text(json.dumps(value, indent=4) + "\n", encoding="utf-8")
