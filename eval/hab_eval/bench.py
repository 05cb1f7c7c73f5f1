"""Figures of speed and memory, each beside a reference or a bound, in one run."""

from __future__ import annotations

import importlib
from collections.abc import Callable

from hab_eval import environments
from hab_eval.bench_beside import run_depth, run_reset, run_sim
from hab_eval.bench_layout import check_scenes
from hab_eval.bench_memory import run_memory
from hab_eval.bench_objects import run_objects
from hab_eval.bench_options import BenchOptions, Suite, WriteLine
from hab_eval.bench_rows import BenchRow
from hab_eval.bench_vector import run_processes
from hab_eval.errors import BenchError

PLAN_MODULE = "hab_spa.bench_plan"


def run_plan(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures the arm planner of the baseline SPA, which brings this suite with it.

    Raises:
        BenchError: It is not installed.
    """
    try:
        suite = importlib.import_module(PLAN_MODULE)
    except ModuleNotFoundError as error:
        raise BenchError(
            f"Suite plan comes with hab_spa, and there is no {error.name!r}: "
            "pip install -e baselines/spa"
        ) from error
    return suite.run_plan(options, write_line)


SUITES: dict[Suite, Callable[[BenchOptions, WriteLine], list[BenchRow]]] = {
    "sim": run_sim,
    "depth": run_depth,
    "reset": run_reset,
    "objects": run_objects,
    "processes": run_processes,
    "memory": run_memory,
    "plan": run_plan,
}


def run_suite(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures one suite, scene by scene, after a look at what is asked for."""
    check_scenes(options.scene_dataset, {scene for group in options.groups for scene in group})
    for env_id in options.envs:
        environments.check_env_id(env_id)
    return SUITES[options.suite](options, write_line)
