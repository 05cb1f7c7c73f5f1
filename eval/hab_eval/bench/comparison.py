"""Alternating comparison with ManiSkill's own environment, for suites sim, depth and reset."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from hab_eval.bench.hab_env import HabEnvFactory, control_of, motion_of
from hab_eval.bench.layout import make_layout
from hab_eval.bench.motion import Motion
from hab_eval.bench.options import BenchOptions
from hab_eval.bench.process import BenchEnv, RemoteEnv, StepTiming
from hab_eval.bench.reference import ReferenceFactory
from hab_eval.bench.rows import BenchRow, make_row
from hab_eval.bench.suite import WriteLine

WARM_UP_STEPS = 5


@contextmanager
def reference(
    options: BenchOptions, scenes: tuple[str, ...], *, obs_mode: str
) -> Iterator[RemoteEnv]:
    """Starts the reference in its own process, on a copy of the scenes."""
    with tempfile.TemporaryDirectory(prefix="hab_bench_") as folder:
        make_layout(options.scene_dataset, scenes, Path(folder))
        factory = ReferenceFactory(scenes=scenes, obs_mode=obs_mode)
        with closing(RemoteEnv(factory, {"MS_ASSET_DIR": folder})) as env:
            yield env


@contextmanager
def hab_env(
    options: BenchOptions, env_id: str, scenes: tuple[str, ...], **settings: Any
) -> Iterator[RemoteEnv]:
    """Starts an environment of `hab_tasks` in its own process."""
    factory = HabEnvFactory.of(options, env_id, scenes, **settings)
    with closing(RemoteEnv(factory, {})) as env:
        yield env


def motions(env_id: str) -> tuple[str, Callable[[int, int], Motion]]:
    """Returns the control mode of an environment and a function (count, seed) -> `Motion`."""
    control = control_of(env_id)
    return control, partial(motion_of, control)


def alternate(
    options: BenchOptions,
    motion: Callable[[int, int], Motion],
    measured: BenchEnv,
    reference: BenchEnv,
    write_line: WriteLine,
) -> list[tuple[StepTiming, StepTiming]]:
    """Times batches of steps alternately; a repeat has the same motion in both environments."""
    for env in (measured, reference):
        env.run_steps(motion(WARM_UP_STEPS, 0))
    pairs: list[tuple[StepTiming, StepTiming]] = []
    for seed in range(options.repeats):
        same = motion(options.step_count, seed)
        pair = (measured.run_steps(same), reference.run_steps(same))
        pairs.append(pair)
        write_line(
            f"repeat {seed + 1} of {options.repeats}: {pair[0].steps_per_s:.1f} steps/s, "
            f"reference {pair[1].steps_per_s:.1f}"
        )
    return pairs


def step_rows(
    name: tuple[str, str, str, str], pairs: Sequence[tuple[StepTiming, StepTiming]]
) -> list[BenchRow]:
    """Returns the rows of alternating timings: speed and physics share."""

    def row(suffix: str, unit: str, read: Callable[[StepTiming], float]) -> BenchRow:
        values, references = [read(a) for a, _ in pairs], [read(b) for _, b in pairs]
        return make_row((*name[:3], name[3] + suffix), values, references, unit=unit)

    return [
        row("", "steps/s", lambda timing: timing.steps_per_s),
        row("_physics_share", "1", lambda timing: timing.physics_share),
        row("_physics_time", "ms/step", lambda timing: timing.engine_ms),
    ]
