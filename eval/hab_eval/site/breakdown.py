"""Results of one run in detail: by layout, by receptacle and by failure, and histograms."""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hab_eval.errors import ResultError
from hab_eval.records.results import EpisodeResult, RunRecord
from hab_eval.records.stats import Estimate, rate

BINS = 20
RECEPTACLE_PREFIX = "receptacle_aabb_"


@dataclass(frozen=True, kw_only=True)
class Share:
    """The success rate of a part of the episodes."""

    name: str
    successes: int
    success: Estimate


@dataclass(frozen=True, kw_only=True)
class Receptacles:
    """Receptacle or handle of the target, for the episodes of skills in given files.

    Attributes:
        by_episode: Episode id -> (scene, receptacle).
    """

    by_episode: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    def of(self, record: RunRecord) -> list[str] | None:
        """Returns the receptacle of each episode; None unless all episodes are known."""
        found = []
        for episode in record.episodes:
            scene, receptacle = self.by_episode.get(episode.id, ("", ""))
            if not receptacle or scene != episode.scene:
                return None
            found.append(receptacle)
        return found


def by_layout(record: RunRecord) -> list[Share]:
    """Returns the success rate in each layout, the lowest first."""
    return _shares(record.episodes, [episode.scene for episode in record.episodes])


def by_receptacle(record: RunRecord, receptacles: Receptacles) -> list[Share]:
    """Returns the success rate for each receptacle, the lowest first; [] if unknown."""
    names = receptacles.of(record)
    return [] if names is None else _shares(record.episodes, names)


def histogram(record: RunRecord, values: Sequence[float]) -> dict[str, Any]:
    """Returns the numbers of successes and failures in bins of `values`, one per episode."""
    low, high = min(values), max(values)
    if high - low < 1e-9 * max(1.0, abs(high)):
        low, high = low - 0.5, high + 0.5
    edges = np.linspace(low, high, BINS + 1)
    succeeded = np.array([episode.success for episode in record.episodes])
    data = np.asarray(values, dtype=np.float64)
    return {
        "edges": [float(edge) for edge in edges],
        "success": np.histogram(data[succeeded], edges)[0].tolist(),
        "failure": np.histogram(data[~succeeded], edges)[0].tolist(),
    }


def read_receptacles(folder: Path) -> Receptacles:
    """Reads the receptacles of skills from every episode file of a folder.

    Raises:
        ResultError: A file cannot be read.
    """
    found: dict[str, tuple[str, str]] = {}
    for path in sorted(folder.glob("*.json.gz")):
        found |= _read_file(path)
    return Receptacles(by_episode=found)


def _read_file(path: Path) -> dict[str, tuple[str, str]]:
    """Returns episode id -> (scene, receptacle) of an episode file."""
    try:
        with gzip.open(path, "rt", encoding="utf-8") as file:
            episodes = json.load(file)["episodes"]
        return {one["id"]: (one["scene_id"], _receptacle(one)) for one in episodes}
    except (OSError, ValueError, KeyError, TypeError, EOFError) as error:
        raise ResultError(f"{path}: cannot be read as an episode file: {error!r}") from error


def _receptacle(episode: Mapping[str, Any]) -> str:
    """Returns the receptacle or the joint of a skill's target; "" for a task."""
    if episode["handle"] is not None and episode["navigation"] is None:
        return str(episode["handle"]["joint"])
    if len(episode["targets"]) != 1:
        return ""
    (target,) = episode["targets"]
    place = target["start"] or target["goal"]
    return str(place[0]).removeprefix(RECEPTACLE_PREFIX) if place else ""


def _shares(episodes: Iterable[EpisodeResult], names: Sequence[str]) -> list[Share]:
    outcomes: dict[str, list[bool]] = {}
    for episode, name in zip(episodes, names, strict=True):
        outcomes.setdefault(name, []).append(episode.success)
    shares = [
        Share(name=name, successes=sum(values), success=rate(values))
        for name, values in outcomes.items()
    ]
    return sorted(shares, key=lambda share: (share.success.mean, -share.success.n, share.name))
