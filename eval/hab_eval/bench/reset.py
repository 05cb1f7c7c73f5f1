"""Suite reset: time of a reset within and between layouts [ms]."""

from __future__ import annotations

from collections.abc import Sequence

from hab_eval.bench.comparison import hab_env, reference
from hab_eval.bench.options import BenchOptions
from hab_eval.bench.process import BenchEnv
from hab_eval.bench.rows import BenchRow, bound_row, make_row
from hab_eval.bench.suite import PICK, Suite, WriteLine

SOFT_RESET_BOUND_MS = 10.0
SCENES = (
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


SUITE = Suite(name="reset", run=run_reset, steps=1, groups=SCENES, is_round=True)
