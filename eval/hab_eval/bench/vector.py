"""Suite vector: the native vector environment, compared with Gymnasium's AsyncVectorEnv."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

from hab_eval.bench.layout import make_layout
from hab_eval.bench.motion import Motion
from hab_eval.bench.options import BenchOptions
from hab_eval.bench.process import RemoteEnv, read_memory
from hab_eval.bench.rows import REFERENCE, BenchRow, bound_row, make_row
from hab_eval.bench.suite import PICK, TIDY_HOUSE, Suite, WriteLine
from hab_eval.bench.vector_envs import (
    ROWS,
    WORKERS,
    Case,
    GroupLoop,
    ReferenceLoop,
    SingleLoop,
    in_async,
    native,
    open_case,
    rate,
)

MANY_ROWS = 64
MEMORY_BOUND_MB = 1500.0
PHYSICS_SHARE_BOUND = 0.6
NAVIGATE = "HabNavigate-v1"

TWO_IN_ASYNC = "two environments in an AsyncVectorEnv"
TWO_PROCESSES = "two processes that step one environment each"


def run_vector(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures each environment, then physics share, two processes, memory and ManiSkill."""
    rows: list[BenchRow] = []
    for (scene,) in options.groups:
        for env_id in options.envs or (PICK, TIDY_HOUSE, NAVIGATE):
            with open_case(options, env_id, scene) as case:
                with closing(native(case, ROWS)) as ours, closing(in_async(case)) as other:
                    pairs = _alternate(options, ours, other, write_line)
                rows.append(_steps_row((*case.name, "16_rows"), pairs, TWO_IN_ASYNC))
                rows += _group_rows(options, case, write_line)
        with open_case(options, PICK, scene) as case:
            rows.append(_two_processes(options, case, write_line))
            rows.append(_memory(options, case))
            rows.append(_mani_skill(options, case, write_line))
    return rows


def _alternate(
    options: BenchOptions, ours: Any, other: Any, write_line: WriteLine
) -> list[tuple[float, float]]:
    """Returns steps/s of two vector environments, measured alternately after a warm-up."""
    count = options.step_count
    for env in (ours, other):
        env.reset(seed=0)
        rate(env, max(1, count // 4), 0)
    pairs = []
    for repeat in range(options.repeats):
        # Both sides take about as long: the other has an eighth of the rows.
        pair = (rate(ours, count, repeat), rate(other, 4 * count, repeat))
        pairs.append(pair)
        write_line(f"repeat {repeat + 1}: {pair[0]:.0f} steps/s, reference {pair[1]:.0f}")
    return pairs


def _steps_row(
    name: tuple[str, str, str, str], pairs: Sequence[tuple[float, float]], reference: str
) -> BenchRow:
    ours, others = [a for a, _ in pairs], [b for _, b in pairs]
    return make_row(name, ours, others, unit="steps/s", reference=reference)


def _group_rows(options: BenchOptions, case: Case, write_line: WriteLine) -> list[BenchRow]:
    """Returns physics share and time outside the engine of a worker's rows."""
    with closing(RemoteEnv(partial(GroupLoop, case), {})) as loop:
        loop.run_steps(Motion(count=max(1, options.step_count // 4), seed=0, arm=True))
        timings = [
            loop.run_steps(Motion(count=options.step_count, seed=repeat, arm=True))
            for repeat in range(options.repeats)
        ]
    write_line(
        f"{case.env_id}: {timings[-1].outside_ms:.3f} ms outside the engine per row and step"
    )
    shares = [timing.physics_share for timing in timings]
    outside, engine = [t.outside_ms for t in timings], [t.engine_ms for t in timings]
    return [
        bound_row((*case.name, "16_rows_physics_share"), shares, PHYSICS_SHARE_BOUND, unit="1"),
        make_row(
            (*case.name, "16_rows_outside_physics"),
            outside,
            engine,
            unit="ms/step",
            reference="engine",
        ),
    ]


def _two_processes(options: BenchOptions, case: Case, write_line: WriteLine) -> BenchRow:
    """Returns the row that compares with independent processes."""
    loop, count = partial(SingleLoop, case), options.step_count
    with closing(native(case, ROWS)) as ours:
        others = [RemoteEnv(loop, {}) for _ in range(WORKERS)]
        try:
            ours.reset(seed=0)
            pairs = []
            for repeat in range(options.repeats + 1):
                mine = rate(ours, count, repeat)
                for other in others:
                    other.start_steps(Motion(count=8 * count, seed=repeat, arm=True))
                slowest_s = max(other.finish_steps().total_s for other in others)
                pairs.append((mine, WORKERS * 8 * count / slowest_s))
        finally:
            for other in others:
                other.close()
    write_line(f"two processes: {pairs[-1][0]:.0f} steps/s, reference {pairs[-1][1]:.0f}")
    name = (*case.name, "16_rows_and_two_processes")
    return _steps_row(name, pairs[1:], TWO_PROCESSES)  # the first was the warm-up


def _memory(options: BenchOptions, case: Case) -> BenchRow:
    """Returns the memory of many rows, in all processes together."""
    with closing(native(case, MANY_ROWS)) as env:
        env.reset(seed=0)
        rate(env, min(50, options.step_count), 0)
        pids = (os.getpid(), *env.worker_pids)
        total_mb = sum(read_memory(pid).pss_mb for pid in pids)
    name = (*case.name, "64_rows_pss")
    return bound_row(name, [total_mb], MEMORY_BOUND_MB, unit="MB")


def _mani_skill(options: BenchOptions, case: Case, write_line: WriteLine) -> BenchRow:
    """Returns the row that compares with ManiSkill's scene environment, in an AsyncVectorEnv."""
    count = options.step_count
    with tempfile.TemporaryDirectory(prefix="hab_bench_") as folder:
        make_layout(options.scene_dataset, (case.scene,), Path(folder))
        loop, variables = partial(ReferenceLoop, case.scene), {"MS_ASSET_DIR": folder}
        with (
            closing(RemoteEnv(loop, variables)) as other,
            closing(native(case, ROWS)) as ours,
        ):
            ours.reset(seed=0)
            pairs = []
            for repeat in range(options.repeats + 1):
                theirs = other.run_steps(Motion(count=count, seed=repeat, arm=True))
                pairs.append((rate(ours, count, repeat), theirs.steps_per_s))
    write_line(f"ManiSkill: {pairs[-1][0]:.0f} steps/s, reference {pairs[-1][1]:.0f}")
    name = (*case.name, "16_rows_and_maniskill")
    return _steps_row(name, pairs[1:], f"two of {REFERENCE} in an AsyncVectorEnv")


SUITE = Suite(name="vector", run=run_vector, steps=100, takes_envs=True)
