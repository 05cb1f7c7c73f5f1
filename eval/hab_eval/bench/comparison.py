"""Suites sim, depth and reset: alternating comparison with ManiSkill's own environment."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from hab_eval.bench.hab_env import HabEnvFactory, control_of, motion_of
from hab_eval.bench.process import BenchEnv, Motion, RemoteEnv, StepTiming
from hab_eval.bench.reference import ReferenceFactory, make_layout
from hab_eval.bench.report import BenchRow, bound_row, make_row
from hab_eval.bench.suite import DENSE_SCENE, FIRST_SCENE, PICK, BenchOptions, Suite, WriteLine
from hab_tasks.envs import ENVS

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


def run_sim(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures each environment with state observations in each scene."""
    every = tuple(ENVS)
    rows: list[BenchRow] = []
    for (scene,) in options.groups:
        with reference(options, (scene,), obs_mode="state") as reference_env:
            for env_id in options.envs_in(scene, every):
                with hab_env(options, env_id, (scene,), obs_mode="state_dict") as env:
                    write_line(f"suite sim, scene {scene}, {env_id}: both environments are ready")
                    control, motion = motions(env_id)
                    pairs = alternate(options, motion, env, reference_env, write_line)
                    rows += step_rows(("sim", scene, env_id, control), pairs)
    return rows


SIM = Suite(
    name="sim",
    run=run_sim,
    steps=200,
    groups=((FIRST_SCENE,), (DENSE_SCENE,)),
    takes_envs=True,
)


def run_depth(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures HabPick-v1 with two depth cameras in each scene."""
    rows: list[BenchRow] = []
    for (scene,) in options.groups:
        with (
            reference(options, (scene,), obs_mode="depth") as reference_env,
            hab_env(options, PICK, (scene,), obs_mode="depth", render_backend="cpu") as env,
        ):
            write_line(f"suite depth, scene {scene}: both environments are ready")
            _, motion = motions(PICK)
            pairs = alternate(options, motion, env, reference_env, write_line)
            rows += step_rows(("depth", scene, PICK, "two_cameras"), pairs)[:1]
    return rows


DEPTH = Suite(name="depth", run=run_depth, steps=40, groups=((FIRST_SCENE,), (DENSE_SCENE,)))


SOFT_RESET_BOUND_MS = 10.0
RESET_SCENES = (
    tuple(f"v3_sc{macro}_staging_{number}" for number in ("00", "10") for macro in range(3)),
    ("apt_0", "apt_1", "apt_2"),
)
"""Default groups of layouts; the suite cycles through each group."""


def run_reset(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures resets of HabPick-v1 within and between layouts."""
    rows: list[BenchRow] = []
    for scenes in options.groups:
        with (
            reference(options, scenes, obs_mode="state") as reference_env,
            hab_env(options, PICK, scenes, obs_mode="state_dict") as env,
        ):
            write_line(f"suite reset, scene {scenes[0]}: both environments are ready")
            rows += _measure_resets(options, scenes[0], env, reference_env, write_line)
    return rows


def _measure_resets(
    options: BenchOptions, scene: str, env: BenchEnv, reference_env: BenchEnv, write_line: WriteLine
) -> list[BenchRow]:
    """Measures resets within a layout, then resets that cycle through the group's layouts."""
    soft_ms = [1e3 * env.soft_reset() for _ in range(options.repeats + 1)][1:]  # first: warm-up
    rounds = [
        [
            (1e3 * env.other_layout(), 1e3 * reference_env.other_layout())
            for _ in range(env.layouts())
        ]
        for _ in range(options.repeats + 1)
    ]
    write_line(f"measured {options.repeats} resets within and cycles through the layouts")
    name = ("reset", scene, PICK)
    again = [pair for pairs in rounds[1:] for pair in pairs]

    def row(variant: str, pairs: Sequence[tuple[float, float]]) -> BenchRow:
        return make_row((*name, variant), [a for a, _ in pairs], [b for _, b in pairs], unit="ms")

    return [
        bound_row((*name, "soft"), soft_ms, SOFT_RESET_BOUND_MS, unit="ms"),
        row("layout_first_time", rounds[0]),
        row("layout", again),
    ]


RESET = Suite(name="reset", run=run_reset, steps=1, groups=RESET_SCENES, is_round=True)
