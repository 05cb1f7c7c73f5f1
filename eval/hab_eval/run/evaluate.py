"""Runs one evaluation, from its configuration to `run.json`.

A worker of a remote executor has its own agent of one row and its own environment. It plays an
episode exactly as a local worker does, so the outcomes are the same.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from itertools import starmap
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import torch

from hab_eval.errors import RunFolderError
from hab_eval.records import provenance
from hab_eval.records.config import MOST_EPISODES, EvalConfig, SavedConfig, short_name
from hab_eval.records.provenance import agent_files
from hab_eval.records.results import (
    SCHEMA_VERSION,
    SPEC_FIELDS,
    FinishedEpisode,
    RunRecord,
    summarize,
    write_record,
)
from hab_eval.run import environments
from hab_eval.run.agents import load_agent
from hab_eval.run.environments import setup_of
from hab_eval.run.isolation import opened_agent
from hab_eval.run.rows import RolloutPlan, job_of, make_rows
from hab_eval.run.run_folder import RunFolder, check_free, locked, open_folder
from hab_eval.run.runner import play
from hab_eval.run.workers import run_agent
from hab_tasks.agent import Agent, AgentSpec
from hab_tasks.engine.rollout import Job
from hab_tasks.errors import FileError, HabError, OptionError, RunStoppedError
from hab_tasks.io.executors import Executor, ExecutorChoice, Task, open_executor
from hab_tasks.io.threads import use_one_thread
from hab_tasks.option_values import whole

if TYPE_CHECKING:
    from hab_tasks.episodes import EpisodeSet


MOST_WORKERS = 256
"""A simulator process needs at least 0.5 GB of memory."""


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options that do not affect the results.

    Attributes:
        out: The run folder.
        workers: Number of worker processes.
        executor: Where the workers run.
        videos: Number of episodes to record, from the first.
        resume: Continue the run in `out`.
        force: Replace the run in `out`.
        device: Torch device of the agent's networks.
    """

    out: Path
    workers: int = 1
    executor: ExecutorChoice = field(default_factory=ExecutorChoice)
    videos: int = 0
    resume: bool = False
    force: bool = False
    device: str = "cpu"

    def __post_init__(self) -> None:
        self.executor.check_executor()
        check_device(self.device)
        whole("workers", self.workers, 1, MOST_WORKERS)
        whole("video", self.videos, 0, MOST_EPISODES)


def check_device(device: str) -> None:
    """Checks that a torch device is available.

    Raises:
        OptionError: It is not; the message lists the available devices.
    """
    count = torch.cuda.device_count()
    there = ["cpu", *(["cuda"] * (count > 0)), *(f"cuda:{index}" for index in range(count))]
    if device not in there:
        raise OptionError(f"device {device!r} is not available. Valid: {', '.join(there)}.")


class Reporter(Protocol):
    """Receives the progress of a run."""

    def generating(self, done: int, total: int) -> None:
        """Called while episodes are generated."""
        ...

    def running(self, done: int, total: int) -> None:
        """Called once before the first episode; `done` were finished before a resume."""
        ...

    def finished(self, finished: FinishedEpisode) -> None:
        """Called after each episode."""
        ...


def evaluate(config: EvalConfig, options: RunOptions, reporter: Reporter) -> RunRecord:
    """Runs all unfinished episodes and writes `run.json`.

    Raises:
        HabError: Bad input, or another run in the same folder.
        RunStoppedError: The run stopped before its last episode.
    """
    environments.check_env_id(config.env)
    environments.env_arguments(config.env_options)
    check_free(options.out, resume=options.resume, force=options.force)
    with locked(options.out):
        return _evaluate(config, options, reporter)


def _evaluate(config: EvalConfig, options: RunOptions, reporter: Reporter) -> RunRecord:
    """Loads the agent and opens the executor; the folder is locked."""
    use_one_thread()
    with (
        opened_agent(config, options.device) as agent,
        _checked_executor(config, options, agent.spec) as executor,
    ):
        return _run(config, options, reporter, agent, executor)


def _checked_executor(
    config: EvalConfig, options: RunOptions, spec: AgentSpec
) -> AbstractContextManager[Executor]:
    """Returns the executor, if it can run an agent with this spec."""
    if options.executor.is_remote:
        check_distributed(config, spec, options.videos)
    if config.step_timeout_s is not None and spec.rows > 1:
        raise OptionError(
            f"--step-timeout needs an agent of one row; {spec.name} has "
            f"{spec.rows}, and a timeout could not be attributed to one of them."
        )
    return open_executor(options.executor, options.workers, device=options.device)


def _run(
    config: EvalConfig, options: RunOptions, reporter: Reporter, agent: Agent, executor: Executor
) -> RunRecord:
    """Runs the evaluation."""
    episodes = environments.load_episode_set(config, reporter.generating, executor)
    saved = SavedConfig(
        config=config,
        versions=provenance.package_versions(config.agent),
        git=provenance.git_commit(),
        agent_files=agent_files(config.agent, agent.spec.files, config.options),
    )
    folder, saved = open_folder(options.out, saved, resume=options.resume, force=options.force)
    finished = _kept(folder, episodes)
    reporter.running(len(finished), len(episodes.episodes))
    try:
        # Closing ends the workers at once on Ctrl-C, not when the generator is collected.
        with contextlib.closing(
            _run_missing(config, options, agent, executor, episodes, finished)
        ) as results:
            for one in results:
                folder.append(one)
                finished[one.episode.id] = replace(one, trace=())  # traces may be large
                reporter.finished(one)
        record = make_record(saved, agent.spec, episodes, finished)
        write_record(folder.record_path, record)
    except (RunStoppedError, FileError) as error:
        raise _with_advice(error, folder, len(finished), len(episodes.episodes)) from error
    except HabError:
        if not finished:
            folder.discard()  # so that the corrected command finds a free folder
        raise
    return record


def make_record(
    saved: SavedConfig,
    spec: AgentSpec,
    episodes: EpisodeSet,
    finished: Mapping[str, FinishedEpisode],
) -> RunRecord:
    """Returns the record of a run, with its episodes in the order of the set."""
    config = saved.config
    ordered = [finished[episode.id] for episode in episodes.episodes]
    results = tuple(one.episode for one in ordered)
    timings_s = {one.episode.id: one.timings_s for one in ordered if one.timings_s}
    return RunRecord(
        schema=SCHEMA_VERSION,
        agent=config.agent,
        agent_name=spec.name,
        **{name: getattr(spec, name) for name in SPEC_FIELDS},
        env=config.env,
        scene_dataset=short_name(episodes.scene_dataset),
        objects=None if config.objects is None else short_name(config.objects),
        split="+".join(part for part in (episodes.split, config.novel) if part),
        seed=config.seed,
        options=config.options,
        skill_config=config.skill_config,
        env_options=config.env_options,
        step_timeout_s=config.step_timeout_s,
        isolated=config.isolated,
        instructions=config.instructions,
        agent_files=saved.agent_files,
        versions=saved.versions,
        git=saved.git,
        device=provenance.device(),
        episodes=results,
        timings_s=timings_s,
        summary=summarize(results, timings_s),
    )


def _kept(folder: RunFolder, episodes: EpisodeSet) -> dict[str, FinishedEpisode]:
    """Reads the finished episodes; raises if they belong to another set."""
    finished = folder.read_journal()
    foreign = finished.keys() - {episode.id for episode in episodes.episodes}
    if foreign:
        raise RunFolderError(
            f"{folder.journal_path}: episode {min(foreign)!r} is not in this run's episode set."
        )
    folder.cut_traces(finished)
    return finished


def _run_missing(
    config: EvalConfig,
    options: RunOptions,
    agent: Agent,
    executor: Executor,
    episodes: EpisodeSet,
    finished: Mapping[str, FinishedEpisode],
) -> Generator[FinishedEpisode, None, None]:
    """Runs the unfinished episodes, in this process or in workers."""
    numbered = starmap(job_of, enumerate(episodes.episodes))
    jobs = [job for job in numbered if job[1].id not in finished]
    plan = RolloutPlan(
        config=config,
        split=episodes.split,
        out=options.out,
        videos=min(options.videos, len(episodes.episodes)),
        device=options.device,
    )
    if options.executor.is_remote:
        return run_distributed(plan, jobs, executor)
    return run_agent(plan, agent, jobs, workers=options.workers)


def _with_advice(
    error: RunStoppedError | FileError, folder: RunFolder, done: int, total: int
) -> RunStoppedError:
    """Adds to a message how to resume and where the traceback is."""
    advice = f" {done} of {total} episodes are kept in {folder.root}; continue with --resume."
    details = error.details if isinstance(error, RunStoppedError) else ""
    if details:
        with contextlib.suppress(OSError):  # e.g. a full disk; the message itself is enough
            folder.error_path.write_text(details, encoding="utf-8", errors="backslashreplace")
            advice += f" Details: {folder.error_path}."
    return RunStoppedError(f"{str(error).rstrip('.')}.{advice}", details=details)


def check_distributed(config: EvalConfig, spec: AgentSpec, videos: int) -> None:
    """Checks that an evaluation can be distributed.

    Raises:
        OptionError: It records videos or has a time limit, or its agent is isolated or batched.
    """
    if videos:
        raise OptionError(
            "--video needs --executor local: workers on other nodes cannot write to --out. "
            "`hab-eval film` records videos of a submission."
        )
    if config.step_timeout_s is not None:
        raise OptionError(
            "--step-timeout needs --executor local: a process of another node cannot be ended in "
            "the middle of a call."
        )
    if config.isolated:
        raise OptionError("--isolated needs --executor local: Ray's workers load the agent.")
    if spec.rows > 1:
        raise OptionError(
            f"--executor ray needs an agent of one row; {spec.name} has {spec.rows}. Its results "
            "could depend on how episodes are divided into batches; use --executor local."
        )


def run_distributed(
    plan: RolloutPlan, jobs: Sequence[Job], executor: Executor
) -> Generator[FinishedEpisode, None, None]:
    """Runs the jobs and yields results as they finish.

    Raises:
        RunStoppedError: An episode raised or its worker died repeatedly.
        HabError: The environment or the agent cannot be created.
    """
    task = Task(start=_start_player, arguments=(plan,), name=_name)
    with contextlib.closing(executor.run(task, jobs)) as results:
        for _, finished in results:
            yield finished


def _start_player(plan: RolloutPlan) -> Callable[[Job], FinishedEpisode]:
    agent = load_agent(plan.config.agent, setup_of(plan.config, plan.device))
    rows = make_rows(plan, agent.spec, 1)

    def play_one(job: Job) -> FinishedEpisode:
        (finished,) = play(agent, rows, iter([job]))
        return finished

    return play_one


def _name(job: Job) -> str:
    return f"Episode {job[1].id!r}"
