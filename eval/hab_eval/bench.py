"""Side-by-side figures: ours against ManiSkill's own environment, alternating in one run."""

from __future__ import annotations

import json
import statistics
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rich.table import Table

from hab_eval.bench_layout import check_scenes, make_layout
from hab_eval.bench_process import RemoteSide, Side, StepTiming
from hab_eval.errors import BenchError, OptionError
from hab_eval.schema import to_json

WriteLine = Callable[[str], None]

ENV_ID = "HabPick-v1"
REFERENCE = "ManiSkill ReplicaCAD_SceneManipulation-v1 fetch pd_ee_delta_pos"
DEFAULT_SCENES = ("v3_sc0_staging_00", "apt_0")
RESET_SCENES = (
    tuple(f"v3_sc{macro}_staging_{number}" for number in ("00", "10") for macro in range(3)),
    ("apt_0", "apt_1", "apt_2"),
)
"""Suite reset goes round each of these groups of layouts, unless layouts are given."""

DEFAULT_STEPS = {"sim": 200, "depth": 40, "reset": 0}
WARM_UP_STEPS = 5
SOFT_RESET_BOUND_MS = 10.0


@dataclass(frozen=True, kw_only=True)
class BenchOptions:
    """What is measured; see `hab-eval bench --help`."""

    suite: Literal["sim", "depth", "reset"]
    scene_dataset: Path
    objects: Path | None = None
    scenes: tuple[str, ...] = ()
    repeats: int = 5
    steps: int | None = None

    def __post_init__(self) -> None:
        if self.repeats < 1:
            raise OptionError(f"repeats must be at least 1, got {self.repeats}.")
        if self.steps is not None and self.steps < 1:
            raise OptionError(f"steps must be at least 1, got {self.steps}.")


@dataclass(frozen=True, kw_only=True)
class BenchRow:
    """One figure beside its reference; `ratio` is `value / reference_value`.

    Attributes:
        name: ``suite/scene/env/variant``.
        value: Median of ours.
        unit: Unit of both values.
        reference: What ours is compared with.
        reference_value: Median of the reference, measured in the same run; a bound is fixed.
        n: Repeats behind each median.
    """

    name: str
    value: float
    unit: str
    reference: str
    reference_value: float
    ratio: float
    n: int


def make_row(
    name: Sequence[str],
    ours: Sequence[float],
    theirs: Sequence[float],
    *,
    unit: str,
    reference: str = REFERENCE,
) -> BenchRow:
    """Returns the row of alternating measurements: suite, scene, env and variant make its name."""
    value, reference_value = statistics.median(ours), statistics.median(theirs)
    return BenchRow(
        name="/".join(name),
        value=value,
        unit=unit,
        reference=reference,
        reference_value=reference_value,
        ratio=value / reference_value,
        n=len(ours),
    )


def run_suite(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures one suite, scene by scene."""
    if options.suite == "reset":
        groups = (options.scenes,) if options.scenes else RESET_SCENES
        if any(len(group) < 2 for group in groups):
            raise OptionError("suite reset goes from layout to layout: give --scene twice or more.")
    else:
        groups = tuple((scene,) for scene in options.scenes or DEFAULT_SCENES)
    check_scenes(options.scene_dataset, {scene for group in groups for scene in group})
    rows: list[BenchRow] = []
    for group in groups:
        with _both_sides(options, group) as (ours, theirs):
            write_line(f"suite {options.suite}, scene {group[0]}: both environments are ready")
            measure = _measure_resets if options.suite == "reset" else _measure_steps
            rows += measure(options, group[0], ours, theirs, write_line)
    return rows


def write_rows(path: Path, rows: Sequence[BenchRow], *, force: bool) -> None:
    """Writes the rows as JSON."""
    check_target(path, force=force)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(to_json(list(rows)), indent=1) + "\n", encoding="utf-8")


def check_target(path: Path, *, force: bool) -> None:
    """Refuses to overwrite a result."""
    if path.exists() and not force:
        raise BenchError(f"--json {path} is there already. Give --force to replace it.")


def row_table(rows: Sequence[BenchRow]) -> Table:
    """Returns the rows as a table for a terminal."""
    table = Table()
    for column in ("name", "ours", "reference", "ratio", "unit", "n"):
        table.add_column(column, overflow="fold")  # a name cut short names nothing
    for row in rows:
        values = (row.value, row.reference_value, row.ratio)
        table.add_row(row.name, *(f"{value:.3f}" for value in values), row.unit, str(row.n))
    return table


@contextmanager
def _both_sides(
    options: BenchOptions, scenes: tuple[str, ...]
) -> Iterator[tuple[RemoteSide, RemoteSide]]:
    """Starts ours and the reference, each in a process of its own."""
    from hab_eval.bench_ours import OursFactory
    from hab_eval.bench_reference import ReferenceFactory

    images = options.suite == "depth"
    ours_factory = OursFactory(
        scene_dataset=str(options.scene_dataset),
        objects=None if options.objects is None else str(options.objects),
        scenes=scenes,
        obs_mode="depth" if images else "state_dict",
        render_backend="cpu" if images else "none",
    )
    their_factory = ReferenceFactory(scenes=scenes, obs_mode="depth" if images else "state")
    with tempfile.TemporaryDirectory(prefix="hab_bench_") as folder:
        make_layout(options.scene_dataset, scenes, Path(folder))
        theirs = RemoteSide(their_factory, {"MS_ASSET_DIR": folder})
        try:
            ours = RemoteSide(ours_factory, {})
            try:
                yield ours, theirs
            finally:
                ours.close()
        finally:
            theirs.close()


def _measure_steps(
    options: BenchOptions, scene: str, ours: Side, theirs: Side, write_line: WriteLine
) -> list[BenchRow]:
    """Alternates batches of steps; both get the same motion in each repeat."""
    count = options.steps or DEFAULT_STEPS[options.suite]
    for side in (ours, theirs):
        side.run_steps(WARM_UP_STEPS, seed=0)
    pairs: list[tuple[StepTiming, StepTiming]] = []
    for seed in range(options.repeats):
        pair = (ours.run_steps(count, seed), theirs.run_steps(count, seed))
        pairs.append(pair)
        write_line(
            f"repeat {seed + 1} of {options.repeats}: {pair[0].steps_per_s:.1f} steps/s, "
            f"reference {pair[1].steps_per_s:.1f}"
        )
    return step_rows(options.suite, scene, pairs)


def step_rows(
    suite: str, scene: str, pairs: Sequence[tuple[StepTiming, StepTiming]]
) -> list[BenchRow]:
    """Turns alternating timings into rows: speed, and in suite sim what the physics takes."""
    variant = "ee" if suite == "sim" else "two_cameras"

    def row(suffix: str, unit: str, read: Callable[[StepTiming], float]) -> BenchRow:
        ours, theirs = [read(a) for a, _ in pairs], [read(b) for _, b in pairs]
        return make_row((suite, scene, ENV_ID, variant + suffix), ours, theirs, unit=unit)

    rows = [row("", "steps/s", lambda timing: timing.steps_per_s)]
    if suite == "sim":
        rows.append(row("_physics_share", "1", lambda timing: timing.physics_share))
        rows.append(row("_physics_time", "ms/step", lambda timing: timing.engine_ms))
    return rows


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
    name = ("reset", scene, ENV_ID)
    bound = [SOFT_RESET_BOUND_MS] * len(soft_ms)
    again = [pair for pairs in rounds[1:] for pair in pairs]

    def row(variant: str, pairs: Sequence[tuple[float, float]]) -> BenchRow:
        return make_row((*name, variant), [a for a, _ in pairs], [b for _, b in pairs], unit="ms")

    return [
        make_row((*name, "soft"), soft_ms, bound, unit="ms", reference="bound"),
        row("layout_first_time", rounds[0]),
        row("layout", again),
    ]
