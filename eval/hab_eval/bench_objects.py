"""Suite objects: time outside the physics engine with few and with many objects in the scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing

from hab_eval.bench_options import TIDY_HOUSE, BenchOptions, WriteLine
from hab_eval.bench_process import RemoteSide, Side, StepTiming
from hab_eval.bench_rows import BenchRow, bound_row, make_row

COUNTS = (10, 30, 100)
"""Movable objects in the scene, those to tidy up included."""

GROWTH_BOUND_PERCENT = 10.0
SHARE_BOUND = 0.4


def run_objects(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures HabTidyHouse-v1 with each of `COUNTS` objects in each scene."""
    from hab_eval.bench_crowd import crowded_episodes
    from hab_eval.bench_ours import OursFactory
    from hab_tasks.episodes import EpisodeRequest

    rows: list[BenchRow] = []
    for (scene,) in options.groups:
        dataset = str(options.scene_dataset)
        objects = None if options.objects is None else str(options.objects)
        request = EpisodeRequest(
            env_id=TIDY_HOUSE, scene_dataset=dataset, objects=objects, scene=scene
        )
        crowded = crowded_episodes(request, COUNTS)
        factory = OursFactory.of(options, TIDY_HOUSE, (scene,), episodes=crowded)
        with closing(RemoteSide(factory, {})) as side:
            write_line(f"suite objects, scene {scene}: the environment is ready")
            rows += object_rows(("objects", scene, TIDY_HOUSE), measure(options, side, write_line))
    return rows


def measure(
    options: BenchOptions, side: Side, write_line: WriteLine
) -> dict[int, list[StepTiming]]:
    """Goes round the episodes of a side, one with each of `COUNTS` objects; first to warm up."""
    from hab_eval.bench_ours import control_of, motion_of

    control = control_of(TIDY_HOUSE)
    timings: dict[int, list[StepTiming]] = {count: [] for count in COUNTS}
    for repeat in range(options.repeats + 1):
        motion = motion_of(control, options.step_count, max(0, repeat - 1))
        for count in COUNTS:
            timings[count].append(side.run_steps(motion))
            side.soft_reset()
        if repeat:
            shown = ", ".join(f"{timings[count][-1].outside_ms:.3f} ({count})" for count in COUNTS)
            write_line(f"repeat {repeat} of {options.repeats}: outside physics {shown} ms/step")
    return {count: found[1:] for count, found in timings.items()}


def object_rows(
    name: tuple[str, str, str], timings: Mapping[int, Sequence[StepTiming]]
) -> list[BenchRow]:
    """Turns timings into rows: time outside the engine, the engine's share, and the growth."""
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
    # Of each repeat by itself, as the machine may be slower in one than in another.
    growth = [100.0 * (b / a - 1.0) for a, b in zip(outside[few], outside[many], strict=True)]
    variant = f"growth_{few}_to_{many}"
    return [*rows, bound_row((*name, variant), growth, GROWTH_BOUND_PERCENT, unit="%")]
