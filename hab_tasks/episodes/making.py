"""Making sets of episodes: at once, or by worker processes while others use the first ones.

Worker processes of any number of runs make one set together: each claims an episode, makes it and
puts it into a folder of the cache, where all processes find it. In the end one of them writes the
set. A process that is killed loses its claim and the episode that it was making.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, NamedTuple, Self

from hab_tasks.episodes.generators.base import Made
from hab_tasks.episodes.schema import EpisodeRequest, EpisodeSet
from hab_tasks.episodes.source import UNLIMITED, EpisodeSource, Progress, open_source
from hab_tasks.errors import FileError, WorkerError, reported
from hab_tasks.io.cache import writable_dir
from hab_tasks.io.executors import Executor
from hab_tasks.io.pool import Worker, end_all

logger = logging.getLogger(__name__)

BACKGROUND = 10
"""Niceness of workers on cores that the caller uses: they get what it leaves of them."""

MOST_WORKERS = 16
POLL_S = 0.05


def load_episodes(
    request: EpisodeRequest,
    count: int,
    progress: Progress | None = None,
    workers: int | Executor = 1,
) -> EpisodeSet:
    """Returns the first `count` episodes; newly generated ones are cached.

    Args:
        request: The request.
        count: Number of episodes.
        progress: Called with (episodes ready, `count`) after each one.
        workers: Number of processes, or an executor; does not change the episodes.
    """
    source = open_source(request)
    if source.prepare(count, workers, progress):
        source.save(count)
    return source.to_set(count)


class Wanted(NamedTuple):
    """The first `count` episodes of a request; `later` if nobody waits for them yet."""

    request: EpisodeRequest
    count: int
    later: bool = False


class EpisodeMaker:
    """Makes episodes in worker processes until it is ended.

    Whatever happens to the workers, each environment generates the episodes that it does not find,
    so what is drawn never depends on them.
    """

    def __init__(self, wanted: Sequence[Wanted], busy: int = 0) -> None:
        """Starts a worker for each core, unless all that is wanted is in the cache.

        Args:
            wanted: What is made, in this order.
            busy: Number of cores that the caller uses while what is wanted later is made.

        Raises:
            HabError: A request is invalid.
        """
        self._wanted, self._there = wanted, [0] * len(wanted)
        self._sources = [open_source(one.request) for one in wanted]
        self._workers: dict[Any, Worker] = {}
        sets = list(zip(wanted, self._sources, strict=True))
        missing = [(one, source) for one, source in sets if not source.holds(one.count)]
        jobs = [(one, writable_dir(source.making)) for one, source in missing]
        cores = len(os.sched_getaffinity(0))
        for number in range(min(cores, MOST_WORKERS) if jobs else 0):
            worker = Worker(_make_all, jobs, number >= cores - busy)
            self._workers[worker.connection] = worker

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def end(self) -> None:
        """Ends the workers; what they have made stays in the cache."""
        end_all(list(self._workers.values()))

    @property
    def is_busy(self) -> bool:
        """Whether workers make episodes."""
        return bool(self._workers)

    def wait(self, number: int, count: int | None = None) -> None:
        """Waits for all, or the first `count`, of the episodes of `wanted[number]`.

        If workers are killed or the disk is full, it says so, and missing episodes are generated
        when they are needed.

        Raises:
            GenerationError: No valid start state was found.
            RunStoppedError: A generator raised.
        """
        count = self._wanted[number].count if count is None else count
        while not self._are_there(number, count) and self._workers:
            for connection in wait(list(self._workers), POLL_S):
                self._hear(self._workers.pop(connection))

    def _are_there(self, number: int, count: int) -> bool:
        """Returns whether the first `count` episodes of `wanted[number]` are there."""
        while self._there[number] < count and self._sources[number].is_there(self._there[number]):
            self._there[number] += 1
        return self._there[number] >= count

    def _hear(self, worker: Worker) -> None:
        """Takes the message of a worker that has ended."""
        rest = "others go on" if self._workers else "missing episodes are generated when needed"
        try:
            worker.receive()
        except WorkerError as error:
            logger.warning("A process that generates episodes %s; %s.", error.how, rest)
        except FileError as error:
            logger.warning("%s; %s.", str(error).rstrip("."), rest)
        finally:
            worker.end()


def _make_all(connection: Connection, jobs: Sequence[tuple[Wanted, Path]], yields: bool) -> None:
    """Makes sets of episodes together with other processes, in folders that they share."""
    logging.disable(logging.WARNING)  # already logged by the parent
    sets: dict[Path, tuple[EpisodeSource, int]] = {}
    for wanted, folder in jobs:
        source = sets[folder][0] if folder in sets else open_source(wanted.request)
        sets[folder] = source, wanted.count
        if wanted.later and yields:
            os.nice(BACKGROUND)
            yields = False
        with Claims(folder.with_suffix(".claims")) as claims:
            for waits in (False, True):  # at last for those that others are making
                _make(source, wanted.count, folder, claims, waits=waits)
    for folder, (source, count) in sets.items():
        with Claims(folder.with_suffix(".claims")) as claims, claims.held(UNLIMITED) as is_mine:
            if is_mine:
                source.prepare(count)
                if source.saved < count:
                    source.save(count)
                source.shared_in(folder).remove(count)
    connection.send(None)


def _make(source: EpisodeSource, count: int, folder: Path, claims: Claims, *, waits: bool) -> None:
    """Makes those of the first `count` episodes that nobody has made or is making."""
    for index in range(count):
        if not source.is_there(index):
            with claims.held(index, waits=waits) as is_mine:
                if is_mine and not source.has(index):
                    source.shared_in(folder).publish(index, _made(source, index))


def _made(source: EpisodeSource, index: int) -> Made:
    try:
        return source.make(index)
    except Exception as error:
        raise reported(f"Episode {index} of {source.env_id} stopped the run", error) from error


class Claims:
    """Numbers that processes claim, each of which one of them holds; they lapse when it ends."""

    def __init__(self, file: Path) -> None:
        """Locks bytes of a file, which stays empty."""
        self._file = file.open("a+b")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    @contextmanager
    def held(self, number: int, *, waits: bool = False) -> Iterator[bool]:
        """Claims a number in the context; yields False if another process holds it."""
        try:
            how = fcntl.LOCK_EX if waits else fcntl.LOCK_EX | fcntl.LOCK_NB
            fcntl.lockf(self._file, how, 1, number)
        except OSError as error:
            yield error.errno not in (errno.EACCES, errno.EAGAIN)  # True on disks without locks
            return
        try:
            yield True
        finally:
            fcntl.lockf(self._file, fcntl.LOCK_UN, 1, number)
