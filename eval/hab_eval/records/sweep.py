"""Axes of a robustness sweep, and the drop in success along each of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from rich.table import Table

from hab_eval.records.paired import compare
from hab_eval.records.plain_text import add_row, figure_text
from hab_eval.records.results import RunRecord
from hab_eval.records.stats import difference_interval, phi_coefficient
from hab_tasks.engine.noise import SensorNoise
from hab_tasks.errors import UnknownNameError
from hab_tasks.figure_style import BLUE, EDGE, bare, new_figure, save

NOISE_FLOOR = "another seed"
"""Name of the run that differs in its episodes alone."""


@dataclass(frozen=True, kw_only=True)
class Level:
    """One run of a sweep, which differs from the committed episodes in one respect.

    Attributes:
        axis: What differs.
        name: By how much.
        env_options: The options of the environment for it.
        other_layouts: Whether the episodes are of other layouts.
        other_seed: Whether the episodes are of another seed.
    """

    axis: str
    name: str
    env_options: dict[str, str] = field(default_factory=dict)
    other_layouts: bool = False
    other_seed: bool = False

    @property
    def folder(self) -> str:
        """Name of the run's folder."""
        words = f"{self.axis} {self.name}".replace("x ", "x")
        return "_".join("".join(c if c.isalnum() or c in ".-" else " " for c in words).split())


def _camera(distance_m: float, angle_deg: float) -> Level:
    angle_rad = f"{math.radians(angle_deg):.4f}"
    changes = {"perturbation.camera_m": f"{distance_m}", "perturbation.camera_rad": angle_rad}
    return Level(
        axis="camera", name=f"{100 * distance_m:g} cm, {angle_deg:g} deg", env_options=changes
    )


def _noise(factor: float) -> Level:
    usual = asdict(SensorNoise())
    changes = {f"sensor_noise.{name}": f"{factor * value:g}" for name, value in usual.items()}
    return Level(axis="noise", name=f"x {factor:g}", env_options=changes)


def _level(axis: str, option: str, value: float, name: str) -> Level:
    return Level(axis=axis, name=name, env_options={option: f"{value:g}"})


AXES: dict[str, tuple[Level, ...]] = {
    "camera": (_camera(0.01, 1.0), _camera(0.03, 3.0)),
    "noise": (_noise(1.0), _noise(4.0)),
    "delay": tuple(
        _level("delay", "action_delay_steps", steps, f"{steps} step{'s' * (steps > 1)}")
        for steps in (1, 3)
    ),
    "friction": tuple(
        _level("friction", "perturbation.friction", factor, f"x {factor}") for factor in (0.3, 3)
    ),
    "lighting": tuple(
        _level("lighting", "perturbation.light", factor, f"x {factor}") for factor in (0.4, 2)
    ),
    "clutter": tuple(
        _level("clutter", "perturbation.clutter", count, f"{count} more") for count in (5, 10)
    ),
    "layout": (Level(axis="layout", name="others", other_layouts=True),),
}
"""Axis -> its levels; one respect at a time."""

BASE = Level(axis="none", name="")
FLOOR = Level(axis="none", name=NOISE_FLOOR, other_seed=True)


def levels_of(axes: Sequence[str]) -> list[Level]:
    """Returns the runs of a sweep: the committed episodes, another seed, and each level.

    Raises:
        UnknownNameError: Unknown axis.
    """
    for axis in axes:
        if axis not in AXES:
            raise UnknownNameError("axis", axis, AXES)
    return [BASE, FLOOR, *(level for axis in dict.fromkeys(axes) for level in AXES[axis])]


@dataclass(frozen=True, kw_only=True)
class Change:
    """Success at a level minus that on the committed episodes.

    Attributes:
        level: The level.
        success: Success rate at it.
        n: Number of its episodes.
        mean: The difference.
        ci95: Its 95 % interval, by Newcombe's hybrid score method.
        p_value: Of McNemar's exact test; None if the episodes are others.
    """

    level: Level
    success: float
    n: int
    mean: float
    ci95: tuple[float, float]
    p_value: float | None = None


def change_of(level: Level, base: RunRecord, changed: RunRecord) -> Change:
    """Compares a level's run with that on the committed episodes, paired if they are the same."""
    before, after = ([one.success for one in run.episodes] for run in (base, changed))
    pair = None if level.other_layouts or level.other_seed else compare(changed, base)
    phi = 0.0
    if pair is not None:
        neither = pair.n - pair.both - pair.only_first - pair.only_second
        phi = phi_coefficient(pair.both, pair.only_first, pair.only_second, neither)
    difference, ci95 = difference_interval(
        (sum(after), len(after)), (sum(before), len(before)), phi
    )
    return Change(
        level=level,
        success=sum(after) / len(after),
        n=len(after),
        mean=difference,
        ci95=ci95,
        p_value=None if pair is None else pair.p_value,
    )


def sweep_table(title: str, changes: Sequence[Change]) -> Table:
    """Returns the changes in percent points."""
    table = Table(title=title)
    for column in ("axis", "level", "n", "success %", "change [95 %]", "p"):
        table.add_column(column)
    for one in changes:
        low, high = (100.0 * bound for bound in one.ci95)
        told = f"{100.0 * one.mean:+.1f} [{low:+.1f}, {high:+.1f}]"
        p_value = "not paired" if one.p_value is None else f"{one.p_value:.3g}"
        success = f"{100.0 * one.success:.1f}"
        add_row(table, one.level.axis, one.level.name, str(one.n), success, told, p_value)
    return table


def draw_sweep(title: str, changes: Sequence[Change], out: Path) -> None:
    """Plots the changes with their intervals; the band is that of the noise floor."""
    figure = new_figure(6.0, 0.9 + 0.28 * len(changes))
    axes = figure.subplots()
    floor = next(one for one in changes if one.level is FLOOR)
    axes.axvspan(*(100.0 * bound for bound in floor.ci95), color=EDGE, alpha=0.18, linewidth=0)
    axes.axvline(0.0, color=EDGE, linewidth=0.8)
    for place, one in enumerate(changes):
        low, high = (100.0 * bound for bound in one.ci95)
        axes.plot([low, high], [place, place], color=EDGE, linewidth=1.2)
        axes.plot(100.0 * one.mean, place, "o", color=BLUE, markersize=5)
    names = [figure_text(f"{one.level.axis}: {one.level.name}") for one in changes]
    axes.set_yticks(range(len(changes)), names, fontsize=8.5)
    axes.invert_yaxis()
    axes.set_xlabel("change of success [% points]; band: another seed", fontsize=9)
    axes.set_title(figure_text(title), fontsize=10, loc="left")
    bare(axes)
    save(figure, out)
