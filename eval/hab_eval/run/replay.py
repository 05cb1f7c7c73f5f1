"""Repeats episodes of a submission compares the results, and reports on them."""

from __future__ import annotations

import contextlib
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from hab_eval.errors import ResultError
from hab_eval.records import provenance
from hab_eval.records.config import EMBEDDED_DATASET, MOST_EPISODES, EvalConfig
from hab_eval.records.plain_text import add_row, plain
from hab_eval.records.provenance import AgentFiles, agent_files
from hab_eval.records.results import SPEC_FIELDS, EpisodeResult, FinishedEpisode, RunRecord
from hab_eval.run import environments
from hab_eval.run.evaluate import Reporter, check_device
from hab_eval.run.isolation import opened_agent
from hab_eval.run.rows import RolloutPlan, job_of
from hab_eval.run.workers import run_agent
from hab_tasks.agent import Agent, AgentSpec
from hab_tasks.errors import OptionError, shown
from hab_tasks.io.threads import use_one_thread
from hab_tasks.option_values import LARGEST_SEED, whole

RETURN_TOLERANCE = 0.01
"""Relative tolerance of returns, and in a unit of reward, of equal outcomes and steps."""

SCORE_TOLERANCE = 0.01
"""Tolerance of scores of equal outcomes and steps: paths differ a little between processors."""

SECONDS_FACTOR, LEAST_SECONDS = 10.0, 0.5
"""Seconds are different if they differ by more than any two machines do; less is not measured."""


@dataclass(frozen=True, kw_only=True)
class Replay:
    """How to repeat episodes of a submission.

    Attributes:
        record: The submission.
        indices: Indices of the episodes to repeat.
        scene_dataset: Path of the scene dataset on this machine; None for the shipped one.
        objects: Path of the object dataset on this machine; None for the shipped objects.
        options: Agent options that replace recorded ones, e.g. the path of a file.
        device: Torch device of the agent's networks.
        workers: Number of worker processes.
        videos: Folder for videos of the episodes; None records none.
        motions: Folder for the motions of the episodes; None records none.
    """

    record: RunRecord
    indices: Sequence[int]
    scene_dataset: str | None = None
    objects: str | None = None
    options: Mapping[str, str] = field(default_factory=dict)
    device: str = "cpu"
    workers: int = 1
    videos: Path | None = None
    motions: Path | None = None

    def config(self) -> EvalConfig:
        """Returns the configuration of the submitted run.

        Raises:
            OptionError: A dataset that is not shipped has no path.
        """
        record = self.record
        if self.scene_dataset is None and record.scene_dataset != EMBEDDED_DATASET:
            raise OptionError(
                f"The run used the scene dataset {shown(record.scene_dataset)}, which is not "
                "shipped; give its folder with --scene-dataset."
            )
        if (self.objects is None) != (record.objects is None):
            used = "the shipped objects" if record.objects is None else shown(record.objects)
            how = "omit" if record.objects is None else "give their folder with"
            raise OptionError(f"The run used {used}; {how} --objects.")
        split, _, novel = record.split.partition("+")
        return EvalConfig(
            agent=record.agent,
            env=record.env,
            scene_dataset=self.scene_dataset or EMBEDDED_DATASET,
            objects=self.objects,
            split=split or None,
            episodes=max(self.indices) + 1,
            seed=record.seed,
            novel=novel or None,
            options={**record.options, **self.options},
            skill_config=record.skill_config,
            env_options=record.env_options,
            step_timeout_s=record.step_timeout_s,
            isolated=record.isolated,
            instructions=record.instructions,
        )


@dataclass(frozen=True, kw_only=True)
class Difference:
    """A value of a repeated run that differs from the record.

    Attributes:
        episode: Id of the episode; "" if the difference is in the agent or the whole run.
        name: Name of the value.
        recorded: Value in the submission.
        repeated: Value of the repeated run.
        small: Whether another processor explains it.
    """

    episode: str
    name: str
    recorded: Any
    repeated: Any
    small: bool = False


def replay(request: Replay, reporter: Reporter) -> tuple[list[FinishedEpisode], list[Difference]]:
    """Repeats episodes; returns them in order, and the differences from the record.

    Raises:
        HabError: The dataset or the agent is missing, or the episodes are others.
        RunStoppedError: An episode stopped the run.
    """
    check_device(request.device)
    use_one_thread()
    config, record = request.config(), request.record
    environments.check_env_id(config.env)
    with opened_agent(config, request.device) as agent:
        repeated = _repeated(request, config, agent, reporter)
        files = agent_files(config.agent, agent.spec.files, config.options)
        differences = _spec_differences(record, agent.spec)
    differences += file_differences(record, files)
    recorded = [record.episodes[index] for index in request.indices]
    pairs = [(old, new.episode) for old, new in zip(recorded, repeated, strict=True)]
    for old, new in pairs:
        differences += episode_differences(old, new)
    if request.videos is None and request.motions is None:  # which take time
        differences += _seconds_difference(pairs)
    return repeated, differences


def _repeated(
    request: Replay, config: EvalConfig, agent: Agent, reporter: Reporter
) -> list[FinishedEpisode]:
    """Plays the episodes."""
    record = request.record
    episodes = environments.load_episode_set(config, reporter.generating, request.workers)
    jobs = [job_of(index, episodes.episodes[index]) for index in request.indices]
    for index in request.indices:
        episode = episodes.episodes[index]
        _check_same_episode(record.episodes[index], episode.id, episode.scene_id)
    plan = RolloutPlan(
        config=config,
        split=episodes.split,
        out=request.videos or request.motions or Path(),
        videos=0 if request.videos is None else config.episodes,
        motions=request.motions is not None,
        device=request.device,
    )
    reporter.running(0, len(jobs))
    found: dict[str, FinishedEpisode] = {}
    with contextlib.closing(run_agent(plan, agent, jobs, workers=request.workers)) as results:
        for finished in results:
            found[finished.episode.id] = finished
            reporter.finished(finished)
    return [found[record.episodes[index].id] for index in request.indices]


def episode_differences(recorded: EpisodeResult, repeated: EpisodeResult) -> list[Difference]:
    """Compares two results of an episode, all but their seconds."""
    names = ("success", "failure", "stages", "steps")
    pairs = [(name, getattr(recorded, name), getattr(repeated, name), False) for name in names]
    before, now = recorded.episode_return, repeated.episode_return
    small = math.isclose(before, now, rel_tol=RETURN_TOLERANCE, abs_tol=RETURN_TOLERANCE)
    pairs.append(("return", before, now, small))
    # Older files have no scores.
    for name in sorted(recorded.scores | repeated.scores) if recorded.scores else ():
        before, now = (one.scores.get(name, math.nan) for one in (recorded, repeated))
        pairs.append((name, before, now, abs(before - now) <= SCORE_TOLERANCE))
    return [
        Difference(episode=recorded.id, name=name, recorded=old, repeated=new, small=small)
        for name, old, new, small in pairs
        if old != new
    ]


def file_differences(record: RunRecord, now: AgentFiles) -> list[Difference]:
    """Compares the agent's weights, and at the record's own commit its code."""
    before = record.agent_files
    if before is None:
        return []
    names = sorted(before.data.keys() | now.data.keys())
    pairs = [(name, before.data.get(name), now.data.get(name)) for name in names]
    if before.git == now.git:  # at another commit, the results tell whether it acts alike
        pairs.append(("code", before.code, now.code))
    return [
        Difference(episode="", name=name, recorded=old, repeated=new)
        for name, old, new in pairs
        if old != new
    ]


def _seconds_difference(pairs: Sequence[tuple[EpisodeResult, EpisodeResult]]) -> list[Difference]:
    """Compares the time that the episodes took."""
    before = sum(recorded.seconds for recorded, _ in pairs)
    now = sum(repeated.seconds for _, repeated in pairs)
    short, long = sorted((before, now))
    if long < LEAST_SECONDS or long <= SECONDS_FACTOR * short:
        return []
    return [Difference(episode="", name="seconds", recorded=before, repeated=now)]


def _spec_differences(record: RunRecord, spec: AgentSpec) -> list[Difference]:
    """Compares the agent's spec with the record."""
    pairs = [("agent_name", record.agent_name, spec.name)]
    pairs += [(name, getattr(record, name), getattr(spec, name)) for name in SPEC_FIELDS]
    return [
        Difference(episode="", name=name, recorded=old, repeated=new)
        for name, old, new in pairs
        if old != new
    ]


def _check_same_episode(recorded: EpisodeResult, episode_id: str, scene: str) -> None:
    if (recorded.id, recorded.scene) != (episode_id, scene):
        raise ResultError(
            f"The submission has episode {shown(recorded.id)} in {shown(recorded.scene)}, and "
            f"these datasets have {shown(episode_id)} in {shown(scene)}; give the datasets of the "
            "run with --scene-dataset and --objects."
        )


IDENTICAL, SAME, DIFFERENT = LEVELS = ("identical", "with the same outcome and steps", "different")
"""How far a repeated episode agrees with its record."""


def draw(total: int, count: int, seed: int) -> tuple[int, ...]:
    """Returns the indices of `count` different episodes, in order; all if there are fewer."""
    whole("episodes", count, 1, MOST_EPISODES)
    whole("sample-seed", seed, 0, LARGEST_SEED)
    drawn = np.random.default_rng(seed).choice(total, size=min(count, total), replace=False)
    return tuple(sorted(int(index) for index in drawn))


def comparison_table(
    name: str, recorded: Sequence[EpisodeResult], repeated: Sequence[EpisodeResult]
) -> Table:
    """Returns a table with one row per repeated episode."""
    table = Table(title=plain(f"{name}: recorded -> repeated"))
    for column in ("episode", "outcome", "steps", "return", ""):
        table.add_column(column, overflow="fold")
    for old, new in zip(recorded, repeated, strict=True):
        verdict = level_of(episode_differences(old, new))
        pairs = [
            (old.failure or "success", new.failure or "success"),
            (str(old.steps), str(new.steps)),
            (f"{old.episode_return:.4f}", f"{new.episode_return:.4f}"),
        ]
        cells = [a if a == b else f"{a} -> {b}" for a, b in pairs]
        add_row(table, old.id, *cells, verdict)
    return table


def level_of(differences: Sequence[Difference]) -> str:
    """Returns how far a repeated episode agrees with its record."""
    if all(one.small for one in differences):
        return SAME if differences else IDENTICAL
    return DIFFERENT


def closing_lines(record: RunRecord, count: int, differences: Sequence[Difference]) -> list[str]:
    """Returns what is different, and a summary, with commits and machines if there are any."""
    lines = []
    for one in differences:
        where = f"episode {one.episode}" if one.episode else "agent"
        values = f"recorded {shown(one.recorded)}, repeated {shown(one.repeated)}"
        if not one.small:  # the table names the others
            lines.append(plain(f"different: {where}: {one.name}: {values}"))
    by_episode: dict[str, list[Difference]] = {}
    for one in differences:
        by_episode.setdefault(one.episode, []).append(one)
    affected = Counter(level_of(found) for name, found in by_episode.items() if name)
    counts = {IDENTICAL: count - affected.total(), **affected}
    told = ", ".join(f"{counts[one]} {one}" for one in LEVELS if counts.get(one))
    summary = f"{count} episodes repeated: {told}"
    if not differences:
        return [f"{summary}."]
    before = f"recorded at commit {record.git or 'unknown'} on {record.device}"
    now = f"repeated at commit {provenance.git_commit() or 'unknown'} on {provenance.device()}"
    return [*lines, plain(f"{summary}; {before}, {now}.")]
