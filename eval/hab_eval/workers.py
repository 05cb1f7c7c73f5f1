"""Evaluation in worker processes on one machine.

An agent of one row runs in every worker, with an environment of its own (`run_parallel`). An agent
of several rows runs once, in the parent, and the workers hold the environments (`run_batched`).

The parent hands out the episodes and is the only one that writes results, so each episode runs
exactly once. An episode's outcome does not depend on its worker (see `rows.LocalRows`).
"""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import signal
import time
import traceback
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any

import numpy as np
import torch
from torch import Tensor

from hab_eval.environments import setup_of
from hab_eval.errors import RunStoppedError
from hab_eval.load_agent import load_agent
from hab_eval.results import FinishedEpisode
from hab_eval.rows import Call, Job, RolloutPlan, Rows, Step, Turn, make_rows
from hab_eval.runner import play
from hab_eval.time_limit import Answered, Asked, TimedAgent
from hab_tasks.agent import Agent, AgentSpec
from hab_tasks.errors import HabError
from hab_tasks.processes import use_one_thread

STOP_TIMEOUT_S = 5.0
PR_SET_PDEATHSIG = 1
"""Of Linux's <sys/prctl.h>."""


@dataclass(frozen=True, kw_only=True)
class _Failure:
    """Why a worker cannot go on. Exceptions themselves do not all survive pickling.

    Attributes:
        details: Traceback; None if the input is bad and the message says all.
    """

    message: str
    details: str | None


@dataclass(kw_only=True)
class _Worker:
    """A worker process, the parent's end of its pipe, and the episodes it is busy with."""

    process: SpawnProcess
    connection: Connection
    episode_ids: tuple[str, ...] = ()
    job: Job | None = None
    asked: Asked | None = None
    ended: bool = False

    def give(self, job: Job | None) -> None:
        """Sends the next job, if there is one."""
        self.job = job
        self.episode_ids = () if job is None else (job[1].id,)
        if job is not None:
            self.send(job)

    def time_left_s(self, limit_s: float | None) -> float | None:
        """Returns how long the agent's present call may still take [s]; None for any time."""
        if limit_s is None or self.asked is None:
            return None
        return max(0.0, self.asked.at_s + limit_s - time.monotonic())

    def take(self, limit_s: float | None, *, ready: bool) -> FinishedEpisode | None:
        """Returns the episode if it is over, None if it goes on; ends a call that takes too long.

        Args:
            limit_s: Longest time of a call [s]; None for any.
            ready: Whether there is an answer.
        """
        answer = self.receive() if ready else None
        if isinstance(answer, FinishedEpisode):
            return answer
        if isinstance(answer, Asked):
            self.asked = answer
            return None
        now_s = answer.at_s if isinstance(answer, Answered) else time.monotonic()
        asked = self.asked
        if asked is None or limit_s is None or self.job is None or now_s - asked.at_s <= limit_s:
            self.asked = None if isinstance(answer, Answered) else asked
            return None
        self.process.kill()
        self.process.join()
        self.ended = True
        return asked.late(now_s, self.job[1])

    def send(self, message: Any) -> None:
        """Sends a message."""
        try:
            self.connection.send(message)
        except OSError as error:
            raise self._died() from error

    def receive(self) -> Any:
        """Takes an answer; raises what the worker says that went wrong."""
        try:
            answer = self.connection.recv()
        except (EOFError, OSError) as error:
            raise self._died() from error
        if isinstance(answer, _Failure):
            if answer.details is None:
                raise HabError(answer.message)
            raise RunStoppedError(answer.message, details=answer.details)
        return answer

    def _died(self) -> RunStoppedError:
        """Describes the end of a worker that said nothing."""
        self.process.join(STOP_TIMEOUT_S)
        code = self.process.exitcode
        how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
        ids = ", ".join(map(repr, self.episode_ids))
        return RunStoppedError(
            f"Episode{'s' * (len(self.episode_ids) > 1)} {ids} stopped the run: its worker process "
            f"{self.process.pid} ended with {how}."
        )


@dataclass(kw_only=True)
class _RemoteRows:
    """Rows in a worker; observations and actions travel as numpy arrays."""

    worker: _Worker
    count: int
    watched: bool
    _playing: dict[int, str] = field(default_factory=dict)

    def send(self, calls: Mapping[int, Call]) -> None:
        """Sends the calls to the worker."""
        self._playing |= {n: c.job[1].id for n, c in calls.items() if not isinstance(c, Step)}
        self.worker.episode_ids = tuple(self._playing.values())
        self.worker.send({number: _packed_call(call) for number, call in calls.items()})

    def receive(self) -> dict[int, Turn]:
        """Waits for the worker's answers."""
        answers: dict[int, Turn] = self.worker.receive()
        for number, turn in answers.items():
            if turn.result is not None:
                del self._playing[number]
        return {n: replace(turn, obs=_unpacked(turn.obs)) for n, turn in answers.items()}

    def abort(self) -> None:
        """Leaves that to the end of the worker."""


def run_agent(
    plan: RolloutPlan, agent: Agent, jobs: Sequence[Job], *, workers: int
) -> Generator[FinishedEpisode, None, None]:
    """Runs the jobs and yields results as they come.

    An agent of one row is loaded anew in each of several workers; and in a worker, even a single
    one, when the time of its calls is limited.

    Raises:
        RunStoppedError: If an episode raised or a worker died.
        HabError: If the environment or the agent cannot be made as asked.
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
        yield from play(agent, [rows], iter(jobs))
    finally:
        rows.close()


def run_batched(
    plan: RolloutPlan, agent: Agent, jobs: Sequence[Job], *, count: int
) -> Generator[FinishedEpisode, None, None]:
    """Runs the jobs with the agent here and the environments of its rows in `count` processes."""
    rows = min(agent.spec.rows, len(jobs))
    shares = [len(range(first, rows, count)) for first in range(min(count, rows))]
    workers = [_start(_serve_rows, plan, agent.spec, share) for share in shares]
    try:
        groups: list[Rows] = [
            _RemoteRows(worker=worker, count=share, watched=plan.videos > 0)
            for worker, share in zip(workers, shares, strict=True)
        ]
        yield from play(agent, groups, iter(jobs))
    finally:
        _stop(workers)


def run_parallel(
    plan: RolloutPlan, jobs: Sequence[Job], *, count: int
) -> Generator[FinishedEpisode, None, None]:
    """Runs the jobs in `count` processes, each with an agent of one row.

    A process whose agent takes longer for a call than allowed is replaced.
    """
    limit_s = plan.config.step_timeout_s
    workers = [_start(_serve_episodes, plan) for _ in range(min(count, len(jobs)))]
    queue = iter(jobs)
    try:
        for worker in workers:
            worker.give(next(queue, None))
        while busy := [(n, worker) for n, worker in enumerate(workers) if worker.job is not None]:
            left_s = [s for _, worker in busy if (s := worker.time_left_s(limit_s)) is not None]
            ready = wait([worker.connection for _, worker in busy], min(left_s, default=None))
            for number, worker in busy:
                finished = worker.take(limit_s, ready=worker.connection in ready)
                if finished is None:
                    continue
                job = next(queue, None)
                if worker.ended:
                    _remove_unfinished_video(plan, worker)
                    if job is not None:
                        worker.connection.close()
                        workers[number] = _start(_serve_episodes, plan)
                workers[number].give(job)
                yield finished
    finally:
        _stop(workers)


def _start(serve: Callable[..., None], *arguments: Any) -> _Worker:
    """Starts a worker. Spawn, not fork: the simulator and Vulkan do not survive a fork."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, serve, *arguments), daemon=True)
    process.start()
    theirs.close()  # so that the pipe ends when the worker does
    return _Worker(process=process, connection=ours)


def _remove_unfinished_video(plan: RolloutPlan, worker: _Worker) -> None:
    """Removes what a worker that was ended filmed of its episode."""
    assert worker.job is not None
    for path in plan.out.glob(f"partial_video_{worker.job[0]:03d}_*"):
        path.unlink()


def _end_with_parent() -> None:
    """Has the kernel end this process with its parent, even when a library never returns."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    parent = multiprocessing.parent_process()
    if parent is not None and not parent.is_alive():
        os._exit(1)  # it ended before the kernel knew


def _stop(workers: Sequence[_Worker]) -> None:
    """Ends all workers, idle or not."""
    for worker in workers:
        worker.connection.close()
        worker.process.terminate()
    for worker in workers:
        worker.process.join(STOP_TIMEOUT_S)
        if worker.process.is_alive():
            worker.process.kill()
            worker.process.join()


def _serve(connection: Connection, serve: Callable[..., None], *arguments: Any) -> None:
    """Runs in the worker until the parent ends the process or the pipe."""
    _end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what Ctrl-C means
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    use_one_thread()
    try:
        serve(connection, *arguments)
    except (EOFError, BrokenPipeError):
        return  # the parent is gone
    except RunStoppedError as error:
        connection.send(_Failure(message=str(error), details=error.details))
    except HabError as error:
        connection.send(_Failure(message=str(error), details=None))
    except Exception as error:
        message = f"A worker could not start: {type(error).__name__}: {error}"
        connection.send(_Failure(message=message, details=traceback.format_exc()))


def _serve_episodes(connection: Connection, plan: RolloutPlan) -> None:
    """Plays the episodes that the parent sends, with an agent of its own."""
    agent = load_agent(plan.config.agent, setup_of(plan.config, plan.device))
    rows = make_rows(plan, agent.spec, 1)
    jobs = iter(connection.recv, None)  # ends with an EOFError
    timed = plan.config.step_timeout_s is not None
    player = TimedAgent(agent, rows, connection.send) if timed else agent
    with contextlib.closing(rows):
        for finished in play(player, [rows], jobs):
            connection.send(finished)


def _serve_rows(connection: Connection, plan: RolloutPlan, spec: AgentSpec, count: int) -> None:
    """Carries out the calls that the parent sends."""
    with contextlib.closing(make_rows(plan, spec, count)) as rows:
        while True:
            calls: dict[int, Any] = connection.recv()
            rows.send({number: _unpacked_call(call) for number, call in calls.items()})
            turns = rows.receive()
            connection.send({n: replace(turn, obs=_packed(turn.obs)) for n, turn in turns.items()})


def _packed_call(call: Call) -> Any:
    return replace(call, action=_packed(call.action)) if isinstance(call, Step) else call


def _unpacked_call(call: Any) -> Call:
    return replace(call, action=_unpacked(call.action)) if isinstance(call, Step) else call


def _packed(value: Any) -> Any:
    """Returns nested groups with arrays for tensors, which would travel in shared memory."""
    if isinstance(value, Mapping):
        return {name: _packed(part) for name, part in value.items()}
    return value.numpy() if isinstance(value, Tensor) else value


def _unpacked(value: Any) -> Any:
    """Returns what `_packed` was given."""
    if isinstance(value, Mapping):
        return {name: _unpacked(part) for name, part in value.items()}
    return torch.from_numpy(value) if isinstance(value, np.ndarray) else value
