"""Parallel evaluation on one machine: worker processes that each run one episode at a time.

The parent hands out episode numbers and is the only one that writes results, so each episode runs
exactly once. An episode's outcome does not depend on its worker (see `runner.run_episode`).
"""

from __future__ import annotations

import multiprocessing
import signal
import traceback
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import TYPE_CHECKING

from hab_eval.errors import RunStoppedError
from hab_eval.results import FinishedEpisode
from hab_eval.runner import RolloutPlan, Rollouts
from hab_tasks.errors import HabError

if TYPE_CHECKING:
    from hab_tasks.episodes import Episode

Job = tuple[int, "Episode"]
"""An episode with its number in the set."""

STOP_TIMEOUT_S = 5.0


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
    """A worker process, the parent's end of its pipe, and what it is busy with."""

    process: SpawnProcess
    connection: Connection
    episode_id: str | None = None


def run_inline(plan: RolloutPlan, jobs: Sequence[Job]) -> Generator[FinishedEpisode, None, None]:
    """Runs the jobs in this process, in order."""
    if not jobs:
        return
    rollouts = Rollouts(plan)
    try:
        for index, episode in jobs:
            yield rollouts.run(index, episode)
    finally:
        rollouts.close()


def run_parallel(
    plan: RolloutPlan, jobs: Sequence[Job], *, count: int
) -> Generator[FinishedEpisode, None, None]:
    """Runs the jobs in `count` processes and yields results as they come.

    Raises:
        RunStoppedError: If an episode raised or a worker died.
        HabError: If the environment or the agent cannot be made as asked.
    """
    workers = [_start(plan) for _ in range(min(count, len(jobs)))]
    queue = iter(jobs)
    try:
        for worker in workers:
            _give_next(worker, queue)
        while busy := [worker for worker in workers if worker.episode_id is not None]:
            ready = wait([worker.connection for worker in busy])
            for worker in (worker for worker in busy if worker.connection in ready):
                finished = _receive(worker)
                _give_next(worker, queue)
                yield finished
    finally:
        _stop(workers)


def _start(plan: RolloutPlan) -> _Worker:
    """Starts a worker. Spawn, not fork: the simulator and Vulkan do not survive a fork."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(plan, theirs), daemon=True)
    process.start()
    theirs.close()  # so that the pipe ends when the worker does
    return _Worker(process=process, connection=ours)


def _give_next(worker: _Worker, queue: Iterator[Job]) -> None:
    """Sends the next job, if there is one."""
    job = next(queue, None)
    worker.episode_id = job[1].id if job else None
    if job is None:
        return
    try:
        worker.connection.send(job)
    except OSError as error:
        raise _died(worker) from error


def _receive(worker: _Worker) -> FinishedEpisode:
    """Takes a worker's answer."""
    try:
        answer = worker.connection.recv()
    except (EOFError, OSError) as error:
        raise _died(worker) from error
    if isinstance(answer, _Failure):
        if answer.details is None:
            raise HabError(answer.message)
        raise RunStoppedError(answer.message, details=answer.details)
    return answer


def _died(worker: _Worker) -> RunStoppedError:
    """Describes the end of a worker that said nothing."""
    worker.process.join(STOP_TIMEOUT_S)
    code = worker.process.exitcode
    how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
    return RunStoppedError(
        f"Episode {worker.episode_id!r} stopped the run: its worker process "
        f"{worker.process.pid} ended with {how}."
    )


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


def _serve(plan: RolloutPlan, connection: Connection) -> None:
    """Runs in the worker: answers each job until the parent ends the process or the pipe."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what Ctrl-C means
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        rollouts = Rollouts(plan)
        while True:
            connection.send(rollouts.run(*connection.recv()))
    except (EOFError, BrokenPipeError):
        return  # the parent is gone
    except RunStoppedError as error:
        connection.send(_Failure(message=str(error), details=error.details))
    except HabError as error:
        connection.send(_Failure(message=str(error), details=None))
    except Exception as error:
        message = f"A worker could not start: {type(error).__name__}: {error}"
        connection.send(_Failure(message=message, details=traceback.format_exc()))
