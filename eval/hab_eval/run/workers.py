"""Evaluation in worker processes on one machine.

An agent of one row runs in every worker, with its own environment (`run_parallel`). An agent of
several rows runs once, in the parent, and the workers step the environments (`run_batched`).

Only the parent assigns episodes and writes results, so each episode runs exactly once. The outcome
of an episode does not depend on its worker (see `hab_tasks.engine.rollout.anew`).
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from itertools import accumulate
from multiprocessing.connection import Connection, wait
from typing import Any

from torch import Tensor

from hab_eval.records.results import FinishedEpisode
from hab_eval.run.agents import load_agent
from hab_eval.run.environments import setup_of, worker_imports
from hab_eval.run.isolation import (
    IsolatedAgent,
    ObsPacker,
    ObsUnpacker,
    packed,
    start_agent,
    unpacked,
)
from hab_eval.run.observations import batched
from hab_eval.run.rows import RolloutPlan, make_rows
from hab_eval.run.runner import play
from hab_eval.run.time_limit import (
    TICK_S,
    CallClock,
    CallEnded,
    CallStarted,
    StopWatch,
    TimedAgent,
)
from hab_tasks.agent import Agent, AgentSpec
from hab_tasks.engine.rollout import Job, Outcome
from hab_tasks.errors import HabError, RunStoppedError
from hab_tasks.io.pool import CLEAN_UP_S, Worker, end_all, received_file, start_server


class _Worker(Worker):
    """A worker process, its isolated agent, its current episodes.

    Attributes:
        agent: Process of its agent, if it is isolated.
        episode_ids: Episodes that it plays.
        job: The only one of them, of a worker with its own agent.
        clock: Clock of the agent's calls.
        ended: Whether it was killed at the time limit.
    """

    def __init__(self, function: Callable[..., None], *arguments: Any) -> None:
        self.agent: Worker | None = None
        self.episode_ids: tuple[str, ...] = ()
        self.job: Job | None = None
        self.clock = CallClock()
        self.ended = False
        super().__init__(function, *arguments)

    @property
    def processes(self) -> tuple[Worker, ...]:
        """The worker, and the agent's process if it has one."""
        return (self,) if self.agent is None else (self, self.agent)

    def give(self, job: Job | None) -> None:
        """Sends the next job, if any."""
        self.job = job
        self.episode_ids = () if job is None else (job[1].id,)
        if job is not None:
            self.send(job)

    def take(self, limit_s: float | None, *, ready: bool) -> FinishedEpisode | None:
        """Returns the episode if it is over, else None; kills the process on a timeout.

        Args:
            limit_s: Time limit of a call [s]; None for no limit.
            ready: Whether the pipe has a message.
        """
        answer = self.receive() if ready else None
        if isinstance(answer, FinishedEpisode):
            return answer
        if isinstance(answer, CallStarted):
            self.clock.start(answer)
            return None
        if isinstance(answer, CallEnded):
            self.clock.end(answer)
        call, call_s = self.clock.call, self.clock.counted_s
        if call is None or limit_s is None or self.job is None or call_s <= limit_s:
            self.clock.call = None if isinstance(answer, CallEnded) else call
            return None
        end_all(self.processes)
        self.ended = True
        return call.timed_out(call_s, self.job[1])

    def death(self) -> HabError:
        """Returns an error that names the episodes."""
        ended, ids = self.ending(), ", ".join(map(repr, self.episode_ids))
        return RunStoppedError(
            f"Episode{'s' * (len(self.episode_ids) > 1)} {ids} stopped the run: its worker process "
            f"{ended.pid} {ended.how}."
        )


class _RemoteRows:
    """Rows in workers; observations and actions travel as numpy arrays.

    Attributes:
        count: Number of rows.
        watched: Whether observers need the agent's current activity.
        doing: That activity, by row.
    """

    def __init__(self, workers: Sequence[_Worker], shares: Sequence[int], *, watched: bool) -> None:
        """Takes workers, and the number of rows of each."""
        self._workers = list(zip(workers, accumulate(shares, initial=0), shares, strict=False))
        self.count, self.watched = sum(shares), watched
        self.doing, self._obs = [""] * self.count, [None] * self.count
        self._unpackers = [ObsUnpacker() for _ in range(self.count)]
        self._playing: dict[int, str] = {}

    def start(self, jobs: Mapping[int, Job]) -> None:
        """See `Rows`."""
        self._playing |= {row: job.episode.id for row, job in jobs.items()}
        self._exchange(jobs, None, ())

    def observe(self) -> Any:
        """See `Rows`."""
        return batched(self._obs)

    def step(self, actions: Tensor, rows: Collection[int]) -> dict[int, Outcome]:
        """See `Rows`."""
        ended = self._exchange({}, actions, rows)
        for row in ended:
            del self._playing[row]
        return ended

    def abort(self) -> None:
        """Does nothing: a worker aborts its rows when it ends."""

    def _exchange(
        self, jobs: Mapping[int, Job], actions: Tensor | None, rows: Collection[int]
    ) -> dict[int, Outcome]:
        """Sends each worker what its rows do, then collects the answers."""
        asked, ended = [], {}
        for worker, first, count in self._workers:
            share = range(first, first + count)
            own_jobs = {row - first: jobs[row] for row in share if row in jobs}
            own_rows = [row - first for row in share if row in rows]
            if own_jobs or own_rows:
                own_actions = None if actions is None else packed(actions[first : first + count])
                worker.episode_ids = tuple(self._playing[n] for n in share if n in self._playing)
                worker.send((self.doing[first : first + count], own_jobs, own_actions, own_rows))
                asked.append((worker, first))
        for worker, first in asked:
            seen, outcomes = worker.receive()
            for row, obs in seen.items():
                self._obs[first + row] = self._unpackers[first + row].unpack(obs)
            ended |= {first + row: outcome for row, outcome in outcomes.items()}
        return ended


def run_agent(
    plan: RolloutPlan, agent: Agent, jobs: Sequence[Job], *, workers: int
) -> Generator[FinishedEpisode, None, None]:
    """Runs the jobs and yields results as they finish.

    An agent of one row is loaded in each worker if there are several workers or a time limit for
    its calls.

    Raises:
        RunStoppedError: An episode raised or a worker died.
        HabError: The environment or the agent cannot be created.
    """
    if not jobs:
        return
    if plan.config.step_timeout_s is not None:
        yield from run_parallel(plan, jobs, count=workers)
    elif workers == 1:
        yield from run_inline(plan, agent, jobs)
    elif agent.spec.rows == 1:
        yield from run_parallel(plan, jobs, count=workers)
    else:
        yield from run_batched(plan, agent, jobs, count=workers)


def run_inline(
    plan: RolloutPlan, agent: Agent, jobs: Sequence[Job]
) -> Generator[FinishedEpisode, None, None]:
    """Runs the jobs in this process."""
    rows = make_rows(plan, agent.spec, min(agent.spec.rows, len(jobs)))
    try:
        yield from play(agent, rows, iter(jobs))
    finally:
        rows.close()


def run_batched(
    plan: RolloutPlan, agent: Agent, jobs: Sequence[Job], *, count: int
) -> Generator[FinishedEpisode, None, None]:
    """Runs the jobs with the agent in this process and its environments in `count` workers."""
    rows = min(agent.spec.rows, len(jobs))
    shares = [len(range(first, rows, count)) for first in range(min(count, rows))]
    start_server(__name__, *worker_imports(plan.config))
    workers = [_Worker(_serve_rows, plan, agent.spec, share) for share in shares]
    try:
        remote = _RemoteRows(workers, shares, watched=plan.videos > 0 or plan.motions)
        yield from play(agent, remote, iter(jobs))
    finally:
        end_all([process for worker in workers for process in worker.processes], CLEAN_UP_S)


def run_parallel(
    plan: RolloutPlan, jobs: Sequence[Job], *, count: int
) -> Generator[FinishedEpisode, None, None]:
    """Runs the jobs in `count` workers, each with its own agent of one row.

    A worker whose agent exceeds the time limit of a call is replaced.
    """
    limit_s = plan.config.step_timeout_s
    start_server(__name__, *worker_imports(plan.config))
    workers = [_start_player(plan) for _ in range(min(count, len(jobs)))]
    queue, watch = iter(jobs), StopWatch()
    try:
        for worker in workers:
            worker.give(next(queue, None))
        while busy := [(n, worker) for n, worker in enumerate(workers) if worker.job is not None]:
            wait_s = None if limit_s is None else TICK_S
            ready = wait([worker.connection for _, worker in busy], wait_s)
            watch.tick((one.clock, [p.pid for p in one.processes]) for _, one in busy)
            for number, worker in busy:
                finished = worker.take(limit_s, ready=worker.connection in ready)
                if finished is None:
                    continue
                job = next(queue, None)
                if worker.ended and job is not None:
                    workers[number] = _start_player(plan)
                workers[number].give(job)
                yield finished
    finally:
        end_all([process for worker in workers for process in worker.processes], CLEAN_UP_S)


def _start_player(plan: RolloutPlan) -> _Worker:
    """Starts a worker that has its own agent, in a second process if it is isolated."""
    worker = _Worker(_serve_episodes, plan)
    if plan.config.isolated:
        worker.agent = start_agent(plan.config, plan.device)
        worker.send_file(worker.agent.connection.fileno())
        worker.agent.connection.close()  # so that the agent ends with the worker
    return worker


def _serve_episodes(connection: Connection, plan: RolloutPlan) -> None:
    """Runs the episodes that the parent sends, with its own agent."""
    agent: Agent
    if plan.config.isolated:
        agent = IsolatedAgent(Connection(received_file(connection)), plan.config.agent)
    else:
        agent = load_agent(plan.config.agent, setup_of(plan.config, plan.device))
    rows = make_rows(plan, agent.spec, 1)
    jobs = iter(connection.recv, None)  # ends with an EOFError
    timed = plan.config.step_timeout_s is not None
    player = TimedAgent(agent, rows, connection.send) if timed else agent
    with contextlib.closing(rows):
        for finished in play(player, rows, jobs):
            connection.send(finished)


def _serve_rows(connection: Connection, plan: RolloutPlan, spec: AgentSpec, count: int) -> None:
    """Executes the calls that the parent sends."""
    with contextlib.closing(make_rows(plan, spec, count)) as rows:
        packers = [ObsPacker() for _ in rows.rows]
        while True:
            rows.doing, jobs, actions, numbers = connection.recv()
            rows.start(jobs)
            ended = rows.step(unpacked(actions), numbers)
            seen = {n: packers[n].pack(rows.rows[n].observe()) for n in (*jobs, *numbers)}
            connection.send((seen, ended))
