"""Suite objects: time outside the physics engine for different numbers of objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing

from hab_eval.bench.hab_env import HabEnvFactory, control_of, motion_of
from hab_eval.bench.object_counts import episodes_by_object_count
from hab_eval.bench.options import BenchOptions
from hab_eval.bench.process import BenchEnv, RemoteEnv, StepTiming
from hab_eval.bench.rows import BenchRow, bound_row, make_row
from hab_eval.bench.suite import TIDY_HOUSE, Suite, WriteLine
from hab_tasks.episodes import EpisodeRequest

COUNTS = (10, 30, 100)
"""Numbers of movable objects in the scene, including the target objects."""

GROWTH_BOUND_PERCENT = 10.0
SHARE_BOUND = 0.4


def run_objects(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures HabTidyHouse-v1 with each of `COUNTS` objects in each scene."""
    rows: list[BenchRow] = []
    for (scene,) in options.groups:
        dataset = str(options.scene_dataset)
        objects = None if options.objects is None else str(options.objects)
        request = EpisodeRequest(
            env_id=TIDY_HOUSE, scene_dataset=dataset, objects=objects, scene=scene
        )
        episodes = episodes_by_object_count(request, COUNTS)
        factory = HabEnvFactory.of(options, TIDY_HOUSE, (scene,), episodes=episodes)
        with closing(RemoteEnv(factory, {})) as env:
            write_line(f"suite objects, scene {scene}: the environment is ready")
            rows += object_rows(("objects", scene, TIDY_HOUSE), measure(options, env, write_line))
    return rows


def measure(
    options: BenchOptions, env: BenchEnv, write_line: WriteLine
) -> dict[int, list[StepTiming]]:
    """Cycles through the episodes, one per number of objects; the first cycle is warm-up."""
    control = control_of(TIDY_HOUSE)
    timings: dict[int, list[StepTiming]] = {count: [] for count in COUNTS}
    for repeat in range(options.repeats + 1):
        motion = motion_of(control, options.step_count, max(0, repeat - 1))
        for count in COUNTS:
            timings[count].append(env.run_steps(motion))
            env.soft_reset()
        if repeat:
            shown = ", ".join(f"{timings[count][-1].outside_ms:.3f} ({count})" for count in COUNTS)
            write_line(f"repeat {repeat} of {options.repeats}: outside physics {shown} ms/step")
    return {count: found[1:] for count, found in timings.items()}


def object_rows(
    name: tuple[str, str, str], timings: Mapping[int, Sequence[StepTiming]]
) -> list[BenchRow]:
    """Returns the rows of timings: time outside the engine, physics share and growth."""
    few, *_, many = sorted(timings)
    outside = {count: [t.outside_ms for t in found] for count, found in timings.items()}
    rows = []
    for count in sorted(timings):
        share = [timing.physics_share for timing in timings[count]]
        time_name = (*name, f"{count}_objects_outside_physics")
        share_name = (*name, f"{count}_objects_physics_share")
        reference = f"{few} objects"
        rows += [
            make_row(time_name, outside[count], outside[few], unit="ms/step", reference=reference),
            bound_row(share_name, share, SHARE_BOUND, unit="1"),
        ]
    # Per repeat, because the machine's speed varies between repeats.
    growth = [100.0 * (b / a - 1.0) for a, b in zip(outside[few], outside[many], strict=True)]
    variant = f"growth_{few}_to_{many}"
    return [*rows, bound_row((*name, variant), growth, GROWTH_BOUND_PERCENT, unit="%")]


SUITE = Suite(name="objects", run=run_objects, steps=200)
