"""Options of the pipeline, and parallel computations, cached by content."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from hab_tasks.errors import DatasetError, HabError, UnknownNameError, WorkerError
from hab_tasks.io.cache import cache_dir, cached_file, find, read_cached, run_dir
from hab_tasks.io.pool import WorkerPool
from hab_tasks.world.scenes.meshes import check_mesh

Progress = Callable[[int, int], None]
"""Called with the number of finished computations, and of all."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """One computation.

    Attributes:
        name: Its result's place in the cache folder, made from all that it depends on.
        source: The file that errors name.
        write: Writes the result, a file or a folder, to a path. Another process must know it by
            name.
    """

    name: str
    source: Path
    write: Callable[[Path], None]

    @property
    def result(self) -> Path:
        """Where the result is or will be."""
        return find(self.name) or cache_dir() / self.name

    @property
    def is_done(self) -> bool:
        """Whether the result is there and can be read; a damaged one is removed."""
        return read_cached(self.name, _check_result) is not None


@dataclass(frozen=True, kw_only=True)
class Tally:
    """Numbers of computed and of cached results."""

    computed: int
    reused: int


def run_jobs(jobs: Iterable[Job], workers: int, progress: Progress) -> Tally:
    """Computes every result that is not cached; jobs of equal names run once.

    Results are kept if a later job fails or the run is stopped.

    Args:
        jobs: The required jobs.
        workers: Number of processes; one works in this process.
        progress: Called after every computation.

    Raises:
        DatasetError: A job failed; the message names its source.
    """
    wanted = {job.name: job for job in jobs}
    missing = [job for job in wanted.values() if not job.is_done]
    progress(0, len(missing))
    done = map(_run, missing) if workers == 1 else _in_parallel(missing, workers)
    for number, _ in enumerate(done, start=1):
        progress(number, len(missing))
    return Tally(computed=len(missing), reused=len(wanted) - len(missing))


def _in_parallel(jobs: list[Job], workers: int) -> Iterator[None]:
    if not jobs:
        return
    try:
        # If the cache is not writable, results are written to this folder, which workers know by an
        # environment variable and this process removes.
        run_dir()
        with WorkerPool(min(workers, len(jobs)), _start_worker) as pool:
            for _ in pool.run(jobs):
                yield
    except WorkerError as error:
        left = [str(job.source) for job in jobs if not job.result.exists()]
        raise DatasetError(
            f"{left[0]}: a worker died on this file or one of the next {workers - 1}. "
            "Run it again with --workers 1 to see on which."
        ) from error


def _start_worker() -> Callable[[Job], None]:
    os.environ["OMP_NUM_THREADS"] = "1"
    return _run


def _check_result(path: Path) -> bool:
    """Raises when a result, a mesh or a folder with one, is damaged."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    if not files:
        raise ValueError("an empty folder")
    for file in files:
        check_mesh(file)
    return True


def _run(job: Job) -> None:
    try:
        cached_file(job.name, job.write, _check_result)
    except HabError as error:
        message = str(error)
        named = message if str(job.source) in message else f"{job.source}: {message}"
        raise DatasetError(named) from error
    except Exception as error:
        raise DatasetError(f"{job.source}: {type(error).__name__}: {error}") from error


COLLISIONS = ("coacd", "hull", "merged-hull", "box")
TEXTURE_FORMATS = ("ktx2", "png")

LARGEST_TEXTURE_PX = 16384

_VERSION = 1
"""Version in every cache name; incrementing it invalidates the cache."""


@dataclass(frozen=True, kw_only=True)
class AssetOptions:
    """Options of one copy.

    Attributes:
        collision: How collision parts are made, one of `COLLISIONS`.
        recompute: Whether they are made from the visual meshes where the dataset brings convex
            parts of its own, too.
        decimate: Wanted share of the triangles of a visual mesh, in (0, 1].
        texture_px: Largest width and height of a texture.
        texture_format: One of `TEXTURE_FORMATS`.
    """

    collision: str = "coacd"
    recompute: bool = False
    decimate: float = 0.5
    texture_px: int = 1024
    texture_format: str = "ktx2"

    def __post_init__(self) -> None:
        """Raises HabError for invalid values."""
        if self.collision not in COLLISIONS:
            raise UnknownNameError("--collision", self.collision, COLLISIONS)
        if self.texture_format not in TEXTURE_FORMATS:
            raise UnknownNameError("--texture-format", self.texture_format, TEXTURE_FORMATS)
        if not 0 < self.decimate <= 1:
            raise HabError(f"--decimate {self.decimate}: a share of the triangles, in (0, 1].")
        if not 4 <= self.texture_px <= LARGEST_TEXTURE_PX:
            raise HabError(f"--texture-size {self.texture_px}: 4 to {LARGEST_TEXTURE_PX} pixels.")

    @property
    def visual_key(self) -> str:
        """Cache key of visual meshes, without their sources."""
        return f"{_VERSION}-{self.decimate:g}-{self.texture_px}-{self.texture_format}"

    @property
    def collision_key(self) -> str:
        """Cache key of collision parts, without their sources."""
        return f"{_VERSION}-{self.collision}{'-recomputed' if self.recompute else ''}"

    def to_json(self) -> str:
        """Returns all options as a JSON object."""
        return json.dumps(asdict(self), indent=2)
