"""Suites sim, depth and reset: ours beside ManiSkill's own environment, alternating."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from hab_eval import environments
from hab_eval.bench_layout import make_layout
from hab_eval.bench_motion import Motion
from hab_eval.bench_options import PICK, BenchOptions, WriteLine
from hab_eval.bench_process import RemoteSide, Side, StepTiming
from hab_eval.bench_rows import BenchRow, bound_row, make_row

WARM_UP_STEPS = 5
SOFT_RESET_BOUND_MS = 10.0


def run_sim(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures each environment on state observations in each scene."""
    every = tuple(environments.env_ids())
    rows: list[BenchRow] = []
    for (scene,) in options.groups:
        with _reference(options, (scene,), obs_mode="state") as theirs:
            for env_id in options.envs_in(scene, every):
                with _ours(options, env_id, (scene,), obs_mode="state_dict") as ours:
                    write_line(f"suite sim, scene {scene}, {env_id}: both environments are ready")
                    control, motion = _motions(env_id)
                    pairs = _alternate(options, motion, ours, theirs, write_line)
                    rows += step_rows(("sim", scene, env_id, control), pairs)
    return rows


def run_depth(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures HabPick-v1 with two depth cameras in each scene."""
    rows: list[BenchRow] = []
    for (scene,) in options.groups:
        with (
            _reference(options, (scene,), obs_mode="depth") as theirs,
            _ours(options, PICK, (scene,), obs_mode="depth", render_backend="cpu") as ours,
        ):
            write_line(f"suite depth, scene {scene}: both environments are ready")
            _, motion = _motions(PICK)
            pairs = _alternate(options, motion, ours, theirs, write_line)
            rows += step_rows(("depth", scene, PICK, "two_cameras"), pairs)[:1]
    return rows


def run_reset(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures resets of HabPick-v1 within a layout, and from layout to layout."""
    rows: list[BenchRow] = []
    for scenes in options.groups:
        with (
            _reference(options, scenes, obs_mode="state") as theirs,
            _ours(options, PICK, scenes, obs_mode="state_dict") as ours,
        ):
            write_line(f"suite reset, scene {scenes[0]}: both environments are ready")
            rows += _measure_resets(options, scenes[0], ours, theirs, write_line)
    return rows


@contextmanager
def _reference(
    options: BenchOptions, scenes: tuple[str, ...], *, obs_mode: str
) -> Iterator[RemoteSide]:
    """Starts the reference in a process of its own, on a copy of the scenes."""
    from hab_eval.bench_reference import ReferenceFactory

    with tempfile.TemporaryDirectory(prefix="hab_bench_") as folder:
        make_layout(options.scene_dataset, scenes, Path(folder))
        factory = ReferenceFactory(scenes=scenes, obs_mode=obs_mode)
        with closing(RemoteSide(factory, {"MS_ASSET_DIR": folder})) as side:
            yield side


@contextmanager
def _ours(
    options: BenchOptions, env_id: str, scenes: tuple[str, ...], **settings: Any
) -> Iterator[RemoteSide]:
    """Starts one of our environments in a process of its own."""
    from hab_eval.bench_ours import OursFactory

    factory = OursFactory.of(options, env_id, scenes, **settings)
    with closing(RemoteSide(factory, {})) as side:
        yield side


def _motions(env_id: str) -> tuple[str, Callable[[int, int], Motion]]:
    """Returns the control mode of an environment, and (count, seed) -> what it moves in it."""
    from hab_eval.bench_ours import control_of, motion_of

    control = control_of(env_id)
    return control, partial(motion_of, control)


def _alternate(
    options: BenchOptions,
    motion: Callable[[int, int], Motion],
    ours: Side,
    theirs: Side,
    write_line: WriteLine,
) -> list[tuple[StepTiming, StepTiming]]:
    """Alternates batches of steps; both get the same motion in each repeat."""
    for side in (ours, theirs):
        side.run_steps(motion(WARM_UP_STEPS, 0))
    pairs: list[tuple[StepTiming, StepTiming]] = []
    for seed in range(options.repeats):
        same = motion(options.step_count, seed)
        pair = (ours.run_steps(same), theirs.run_steps(same))
        pairs.append(pair)
        write_line(
            f"repeat {seed + 1} of {options.repeats}: {pair[0].steps_per_s:.1f} steps/s, "
            f"reference {pair[1].steps_per_s:.1f}"
        )
    return pairs


def step_rows(
    name: tuple[str, str, str, str], pairs: Sequence[tuple[StepTiming, StepTiming]]
) -> list[BenchRow]:
    """Turns alternating timings into rows: speed, and what of it the physics takes."""

    def row(suffix: str, unit: str, read: Callable[[StepTiming], float]) -> BenchRow:
        ours, theirs = [read(a) for a, _ in pairs], [read(b) for _, b in pairs]
        return make_row((*name[:3], name[3] + suffix), ours, theirs, unit=unit)

    return [
        row("", "steps/s", lambda timing: timing.steps_per_s),
        row("_physics_share", "1", lambda timing: timing.physics_share),
        row("_physics_time", "ms/step", lambda timing: timing.engine_ms),
    ]


def _measure_resets(
    options: BenchOptions, scene: str, ours: Side, theirs: Side, write_line: WriteLine
) -> list[BenchRow]:
    """Measures resets in place, then resets that go round the layouts of the group."""
    soft_ms = [1e3 * ours.soft_reset() for _ in range(options.repeats + 1)][1:]  # first: warm-up
    rounds = [
        [(1e3 * ours.other_layout(), 1e3 * theirs.other_layout()) for _ in range(ours.layouts())]
        for _ in range(options.repeats + 1)
    ]
    write_line(f"{options.repeats} resets in place and rounds of the layouts are measured")
    name = ("reset", scene, PICK)
    again = [pair for pairs in rounds[1:] for pair in pairs]

    def row(variant: str, pairs: Sequence[tuple[float, float]]) -> BenchRow:
        return make_row((*name, variant), [a for a, _ in pairs], [b for _, b in pairs], unit="ms")

    return [
        bound_row((*name, "soft"), soft_ms, SOFT_RESET_BOUND_MS, unit="ms"),
        row("layout_first_time", rounds[0]),
        row("layout", again),
    ]
