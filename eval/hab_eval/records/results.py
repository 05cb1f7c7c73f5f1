"""The result file `run.json`: schema, aggregates, validation and atomic writing.

Aggregates are computed from the episodes. A file whose summary does not match its episodes is
rejected, so that leaderboard rows can be trusted.
"""

from __future__ import annotations

import contextlib
import json
import math
import mmap
import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from hab_eval.errors import ResultError
from hab_eval.records.config import MOST_EPISODES
from hab_eval.records.provenance import AgentFiles
from hab_eval.records.schema import parse_json, read_dataclass
from hab_eval.records.stats import Estimate, bootstrap_mean, mean, rate
from hab_tasks.constants import CAMERA_HFOV_RAD, CAMERA_SIZE_PX
from hab_tasks.errors import OptionError, shown
from hab_tasks.io.files import written_aside
from hab_tasks.typed_values import Count, Name, Seconds, to_json

SCHEMA_VERSION = 1
SPEC_FIELDS = (
    *("privileged", "control_mode", "obs_mode", "target_frame", "handle_position", "targets"),
    *("instruction", "cameras", "camera_size_px", "camera_hfov_rad", "invisible_arm"),
    "proprioception",
)
"""Fields of an agent's spec that its record has, too."""

SUMMARY_TOLERANCE = 1e-6
"""Relative tolerance: the last digits of bootstrap percentiles differ between NumPy versions."""

AGENT_TIMEOUT = "agent timeout"
"""Failure category: a call of the agent took longer than `step_timeout_s`."""

SHORTEST_EPISODE_BYTES = 90
"""The keys of an episode with their shortest values, in a record and in a journal."""

EPISODE = re.compile(rb'"failure"\s*:\s*[n"]')
"""What each episode of a file has once: null or a name; timings and scores are numbers."""

UNSAFE = re.compile(r"[^A-Za-z0-9._-]+")
"""Replaced in the file names of videos."""


@dataclass(frozen=True, kw_only=True)
class EpisodeResult:
    """One finished episode. Only `seconds` may differ between two runs with the same seed.

    Attributes:
        id: The episode's id in its set.
        scene: Scene id.
        success: Whether the episode ended in success.
        stages: Whether each stage of a task was reached; {} for a skill.
        steps: Control steps taken.
        failure: None on success, else the environment's category, else the agent's, else timeout;
            `AGENT_TIMEOUT` if a call of the agent exceeded the time limit.
        episode_return: Undiscounted sum of rewards (``return`` in JSON).
        scores: ``sct`` of Pick, ``spl`` of Navigate (`HabEnv.score_names`); absent in older files.
        seconds: Wall time of agent and simulator [s], without resets and video.
    """

    id: Name
    scene: str
    success: bool
    stages: dict[str, bool]
    steps: Count
    failure: Name | None
    episode_return: float = field(metadata={"key": "return"})
    scores: dict[str, float] = field(default_factory=dict)
    seconds: Seconds


@dataclass(frozen=True, kw_only=True)
class FinishedEpisode:
    """Result and agent report of an episode: one line of `episodes.jsonl`.

    Attributes:
        episode: The result.
        timings_s: Durations reported by the agent [s].
        trace: Log of the agent's beliefs and actions; written to `traces.jsonl` instead.
    """

    episode: EpisodeResult
    timings_s: dict[str, Seconds]
    trace: tuple[dict[str, Any], ...] = ()


@dataclass(frozen=True, kw_only=True)
class Duration:
    """A duration reported once per episode: mean and maximum over `n` episodes [s]."""

    mean: float
    max: float
    n: int


@dataclass(frozen=True, kw_only=True)
class Summary:
    """Aggregates of the episodes."""

    success: Estimate
    stages: dict[str, Estimate]
    failures: dict[str, int]
    mean_return: Estimate = field(metadata={"key": "return"})
    scores: dict[str, Estimate] = field(default_factory=dict)
    mean_steps: float
    seconds_per_step: float
    timings_s: dict[str, Duration]


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """One evaluation: configuration, environment, software, and the result of each episode.

    Attributes:
        schema: Version of this schema.
        agent: ``module:factory``.
        agent_name: Display name.
        privileged: Whether the agent read the simulator's ground-truth state.
        control_mode: Control mode of the agent's spec.
        obs_mode: Observation mode of the agent's spec.
        target_frame: Frame of the observed target (an option of the environment).
        handle_position: Whether the agent observed the position of the handle.
        targets: How the goal was given: ``positions`` or ``language``; with the next four absent
            in older files.
        instruction: The observed instruction, ``task`` or ``stage``; None without one.
        cameras: Names of the observed cameras; None for the environment's.
        camera_size_px: Width and height of their images.
        camera_hfov_rad: Their horizontal field of view.
        invisible_arm: Whether they did not show the arm.
        proprioception: Whether the agent observed proprioception.
        env: Environment id.
        scene_dataset: Name of the scene dataset.
        objects: Name of the object folder, None for the shipped objects.
        split: Episode split, with ``+objects`` or ``+receptacles`` if these are held out.
        seed: Seed of the episode set and of the agent.
        options: Agent options; absent in older files.
        skill_config: Reward weights and thresholds that replace the skills' defaults.
        env_options: Options of the environment that differ from the protocol, name -> value.
        step_timeout_s: Time limit for one call of the agent [s]; None for no limit.
        isolated: Whether the agent ran in processes of its own, without an environment.
        instructions: Wording of the instructions, ``fixed`` or ``varied``.
        agent_files: The agent's code and weights; None in older files.
        versions: Package -> version.
        git: Commit of the sources, with ``-dirty`` if they were edited; all commits, joined by
            " then ", if the run was resumed on another; None outside a checkout.
        device: Processor and graphics card.
        episodes: In the order of the episode set.
        timings_s: Episode id -> durations reported by the agent [s]; not part of `episodes`,
            which are identical in two runs with the same seed.
        summary: Computed from `episodes` and `timings_s`.
    """

    schema: int
    agent: Name
    agent_name: Name
    privileged: bool
    control_mode: str
    obs_mode: str
    target_frame: str = "base"
    handle_position: bool = False
    targets: str = "positions"
    instruction: str | None = None
    cameras: tuple[str, ...] | None = None
    camera_size_px: int = CAMERA_SIZE_PX
    camera_hfov_rad: float = CAMERA_HFOV_RAD
    invisible_arm: bool = False
    proprioception: bool = True
    env: Name
    scene_dataset: Name
    objects: str | None
    split: str
    seed: Count
    options: dict[str, str] = field(default_factory=dict)
    skill_config: dict[str, float] = field(default_factory=dict)
    env_options: dict[str, str] = field(default_factory=dict)
    step_timeout_s: float | None = None
    isolated: bool = False
    instructions: str = "fixed"
    agent_files: AgentFiles | None = None
    versions: dict[str, str]
    git: str | None
    device: str
    episodes: tuple[EpisodeResult, ...]
    timings_s: dict[str, dict[str, Seconds]]
    summary: Summary


def summarize(
    episodes: Sequence[EpisodeResult], timings_s: Mapping[str, Mapping[str, float]]
) -> Summary:
    """Computes the aggregates; needs at least one episode."""
    stage_names = sorted({name for episode in episodes for name in episode.stages})
    score_names = sorted({name for episode in episodes for name in episode.scores})
    failures = Counter(episode.failure for episode in episodes if episode.failure is not None)
    steps = sum(episode.steps for episode in episodes)
    return Summary(
        success=rate([episode.success for episode in episodes]),
        stages={
            name: rate([episode.stages.get(name, False) for episode in episodes])
            for name in stage_names
        },
        failures=dict(sorted(failures.items(), key=lambda item: (-item[1], item[0]))),
        mean_return=bootstrap_mean([episode.episode_return for episode in episodes]),
        scores={
            name: bootstrap_mean([episode.scores.get(name, 0.0) for episode in episodes])
            for name in score_names
        },
        mean_steps=steps / len(episodes),
        seconds_per_step=math.fsum(episode.seconds for episode in episodes) / max(steps, 1),
        timings_s=_durations(timings_s),
    )


def write_record(path: Path, record: RunRecord) -> None:
    """Writes `run.json` atomically."""
    with written_aside(path) as scratch, scratch.open("w", encoding="utf-8") as file:
        json.dump(to_json(record), file, indent=1, allow_nan=False)
        file.write("\n")
        file.flush()
        os.fsync(file.fileno())


def read_record(path: Path) -> RunRecord:
    """Reads and validates `run.json`."""
    check_size(path)
    data = parse_json(path)
    version = data.get("schema") if isinstance(data, dict) else None
    if version != SCHEMA_VERSION:
        raise ResultError(f"{path}: schema {shown(version)}, this version reads {SCHEMA_VERSION}.")
    if isinstance(episodes := data.get("episodes"), list):
        check_count(len(episodes), path)
    record = read_dataclass(RunRecord, data, where=str(path))
    _check(record, path)
    return record


def check_finished(finished: FinishedEpisode, where: str) -> None:
    """Checks that the journal line of an episode can be read back.

    Raises:
        ResultError: It cannot; the message names `where`, the field and the value.
    """
    line = to_json(replace(finished, trace=()))
    check_episode(read_dataclass(FinishedEpisode, line, where).episode, where)


def check_episode(episode: EpisodeResult, where: str) -> None:
    """Checks that an episode has either succeeded or failed.

    Raises:
        ResultError: Both or neither.
    """
    if episode.success != (episode.failure is None):
        raise ResultError(
            f"{where}: episode {episode.id!r} has success {episode.success} and failure "
            f"{episode.failure!r:.80}; exactly one of the two is expected."
        )


def _check_stages(episodes: Sequence[EpisodeResult], path: Path) -> None:
    """Checks that all episodes have the same stages; one that never started has none."""
    staged = [episode for episode in episodes if episode.stages]
    for episode in staged:
        if episode.stages.keys() != staged[0].stages.keys():
            raise ResultError(
                f"{path}: episode {episode.id!r} has stages {shown(list(episode.stages))}, and "
                f"episode {staged[0].id!r} has {shown(list(staged[0].stages))}."
            )


def _durations(timings_s: Mapping[str, Mapping[str, float]]) -> dict[str, Duration]:
    """Aggregates each duration over the episodes that report it."""
    names = sorted({name for one in timings_s.values() for name in one})
    found = {name: [one[name] for one in timings_s.values() if name in one] for name in names}
    return {
        name: Duration(mean=mean(values), max=max(values), n=len(values))
        for name, values in found.items()
    }


def _check(record: RunRecord, path: Path) -> None:
    """Checks the consistency of a record."""
    if not record.episodes:
        raise ResultError(f"{path}: episodes is empty.")
    counts = Counter(episode.id for episode in record.episodes)
    twice = [name for name, count in counts.items() if count > 1]
    if twice:
        raise ResultError(f"{path}: episode {twice[0]!r} appears {counts[twice[0]]} times.")
    foreign = record.timings_s.keys() - counts.keys()
    if foreign:
        raise ResultError(f"{path}: timings_s: unknown episode {shown(min(foreign))}.")
    for episode in record.episodes:
        check_episode(episode, str(path))
    _check_stages(record.episodes, path)
    expected = to_json(summarize(record.episodes, record.timings_s))
    different = _first_difference(expected, to_json(record.summary), "summary")
    if different:
        raise ResultError(f"{path}: {different} does not follow from the episodes.")


def _first_difference(expected: object, found: object, where: str) -> str | None:
    """Returns the path of the first difference between two JSON values, None if equal."""
    if isinstance(expected, dict) and isinstance(found, dict):
        if expected.keys() != found.keys():
            return where
        pairs = [(expected[key], found[key], f"{where}.{key}") for key in expected]
    elif isinstance(expected, list) and isinstance(found, list):
        if len(expected) != len(found):
            return where
        pairs = [
            (a, b, f"{where}[{i}]") for i, (a, b) in enumerate(zip(expected, found, strict=True))
        ]
    elif isinstance(expected, float) and isinstance(found, (int, float)):
        same = math.isclose(expected, found, rel_tol=SUMMARY_TOLERANCE, abs_tol=1e-12)
        return None if same else where
    else:
        return None if expected == found else where
    return next((hit for pair in pairs if (hit := _first_difference(*pair))), None)


def read_runs(paths: Sequence[Path]) -> list[RunRecord]:
    """Reads finished runs, each given as its folder or its `run.json`."""
    if not paths:
        raise OptionError("failures needs at least one run: its folder or its run.json.")
    return [_read(path) for path in paths]


def _read(path: Path) -> RunRecord:
    """Reads one run."""
    if not os.path.isdir(path):  # unlike Path.is_dir, False for an invalid name
        return read_record(path)
    file = path / "run.json"
    if not file.is_file():
        raise ResultError(f"{file}: not found; finish the run with --resume.")
    return read_record(file)


def check_size(path: Path) -> None:
    """Checks the number of episodes of a large record or journal without parsing it.

    A file that cannot be read passes; its reader reports it.

    Raises:
        ResultError: There are more than `MOST_EPISODES`.
    """
    with contextlib.suppress(OSError):
        if not os.path.isfile(path):  # unlike Path.is_file, False for an invalid name
            return
        if path.stat().st_size > MOST_EPISODES * SHORTEST_EPISODE_BYTES:
            check_count(_count(path), path)


def check_count(count: int, path: Path) -> None:
    """Checks a number of episodes; `path` is named in the error."""
    if count > MOST_EPISODES:
        raise ResultError(f"{path}: {count} episodes; at most {MOST_EPISODES} are valid.")


def _count(path: Path) -> int:
    """Returns the number of episodes; the system reads the file in pages."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        return sum(1 for _ in EPISODE.finditer(text))


def video_name(index: int, episode_id: str) -> str:
    """Returns the file name of an episode's video, without suffix."""
    return f"video_{index:03d}_{UNSAFE.sub('-', episode_id)}"


def outcome_of(episode: EpisodeResult) -> str:
    """Returns ``success`` or the failure category."""
    return "success" if episode.failure is None else episode.failure


def highlights(record: RunRecord) -> tuple[int, ...]:
    """Returns the indices of the first success and of the first failure of each category."""
    first: dict[str | None, int] = {}
    for index, episode in enumerate(record.episodes):
        first.setdefault(episode.failure, index)  # None for a success
    return tuple(sorted(first.values()))
