"""Suite episodes: CPU and wall time of episode generation, with the bounds of training sets."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from hab_eval.bench.report import BenchRow, bound_row
from hab_eval.bench.suite import BenchOptions, Suite, WriteLine
from hab_tasks.envs import ENVS
from hab_tasks.episodes import EpisodeRequest
from hab_tasks.episodes.source import open_source
from hab_tasks.io.pool import WorkerPool
from hab_tasks.registration import TASKS

WORKERS = 2
SPLIT = "train"
SET_SIZE = 5000
SKILL_BOUND_S, TASK_BOUND_S = 360.0 / SET_SIZE, 15.0 / 100
"""Bounds on the wall time of an episode: 6 minutes for 5,000 of a skill, 15 s for 100 of a task."""

WARM_UP = 2
"""Episodes that each worker generates first, to load meshes and layouts."""


@dataclass(frozen=True, kw_only=True)
class Generation:
    """Times of one repeat.

    Attributes:
        episodes: Number of episodes.
        cpu_s: CPU time of all workers.
        wall_s: Time until the last one was finished.
    """

    episodes: int
    cpu_s: float
    wall_s: float


def generation_rows(
    name: tuple[str, str, str], timings: Sequence[Generation], wall_bound_s: float
) -> list[BenchRow]:
    """Returns the rows of one environment; the time of a whole set is extrapolated."""
    cpu_s = [timing.cpu_s / timing.episodes for timing in timings]
    wall_s = [timing.wall_s / timing.episodes for timing in timings]
    whole_s = [SET_SIZE * seconds for seconds in wall_s]
    return [
        bound_row((*name, "cpu_per_episode"), cpu_s, WORKERS * wall_bound_s, unit="s"),
        bound_row((*name, "wall_per_episode"), wall_s, wall_bound_s, unit="s"),
        bound_row(
            (*name, f"{SET_SIZE}_episodes_extrapolated"), whole_s, SET_SIZE * wall_bound_s, unit="s"
        ),
    ]


def run_episodes(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures each environment, in the training layouts or in the given ones."""
    rows: list[BenchRow] = []
    for scene in [group[0] for group in options.groups] or [None]:
        for env_id in options.envs or tuple(ENVS):
            request = EpisodeRequest(
                env_id=env_id,
                scene_dataset=options.scene_dataset,
                objects=options.objects,
                split=SPLIT if scene is None else None,
                scene=scene,
            )
            timings = generate(request, options.repeats, options.step_count)
            bound_s = TASK_BOUND_S if env_id in TASKS else SKILL_BOUND_S
            found = generation_rows(("episodes", scene or SPLIT, env_id), timings, bound_s)
            write_line(f"{env_id}: {found[0].value:.3f} CPU seconds per episode")
            rows += found
    return rows


def generate(request: EpisodeRequest, repeats: int, count: int) -> list[Generation]:
    """Generates `repeats` times `count` new episodes in workers that have warmed up."""
    timings = []
    with WorkerPool(WORKERS, _timed_source, (request,)) as pool:
        warm = WORKERS * WARM_UP
        list(pool.run(range(warm)))
        for repeat in range(repeats):
            first = warm + repeat * count
            started = time.perf_counter()
            cpu_s = sum(each_s for _, each_s in pool.run(range(first, first + count)))
            wall_s = time.perf_counter() - started
            timings.append(Generation(episodes=count, cpu_s=cpu_s, wall_s=wall_s))
    return timings


def _timed_source(request: EpisodeRequest) -> Callable[[int], float]:
    """Returns a function that generates an episode and returns the CPU time."""
    logging.disable(logging.WARNING)  # already logged by the parent
    source = open_source(request)

    def make(index: int) -> float:
        started = time.process_time()
        source.make(index)
        return time.process_time() - started

    return make


SUITE = Suite(name="episodes", run=run_episodes, steps=40, groups=(), takes_envs=True)
