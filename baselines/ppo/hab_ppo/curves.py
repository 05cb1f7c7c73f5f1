"""Learning curves of runs as a picture (S I.2, Figs. 26 to 28)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hab_ppo.errors import PolicyFileError
from hab_ppo.progress import FILE, read_progress
from hab_tasks.files import written_aside

PANELS = (
    (("train/success", "eval/success"), "success"),
    (("train/return", "eval/return"), "return"),
    (("time/steps_per_s",), "steps/s"),
)
"""Metrics of each panel, and its label; those of evaluations are drawn with markers."""

SIZE_IN = (12.0, 3.6)
DPI = 120


def draw_curves(runs: Sequence[Path], out: Path) -> None:
    """Draws the curves of runs over their steps, one colour each.

    Raises:
        PolicyFileError: A folder holds no run, or one without an update.
    """
    from matplotlib.figure import Figure  # without pyplot, and so without a display

    figure = Figure(figsize=SIZE_IN, layout="constrained")
    axes = figure.subplots(1, len(PANELS))
    for number, run in enumerate(runs):
        entries = read_progress(run)
        if not entries:
            raise PolicyFileError(f"{run} has no {FILE} with an update.")
        for axis, (metrics, _) in zip(axes, PANELS, strict=True):
            for metric in metrics:
                _draw(axis, entries, metric, f"C{number}", run.name)
    for axis, (_, label) in zip(axes, PANELS, strict=True):
        axis.set_xlabel("environment steps")
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[0].set_ylim(0, 1)
    axes[0].legend(fontsize="small")
    with written_aside(out) as scratch:
        figure.savefig(scratch, format="png", dpi=DPI)


def _draw(axis: Any, entries: Sequence[dict[str, Any]], metric: str, colour: str, run: str) -> None:
    points = [(entry["steps"], entry[metric]) for entry in entries if metric in entry]
    if not points:
        return
    greedy = metric.startswith("eval/")
    label = f"{run}, {'greedy, validation' if greedy else 'training'}"
    style = {"marker": "o"} if greedy else {"alpha": 0.5}
    axis.plot(*zip(*points, strict=True), color=colour, label=label, **style)
