"""Learning curves of runs as a picture (S I.2, Figs. 26 to 28)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure  # without pyplot, and so without a display

from hab_ppo import checkpoint
from hab_ppo.checkpoint import PolicyFileError
from hab_ppo.commands import PlotCommand
from hab_ppo.plan import CLONED
from hab_ppo.progress import FILE, read_progress
from hab_tasks.errors import OptionError
from hab_tasks.io.console import tell
from hab_tasks.io.files import check_file, written_aside

PANELS = (
    (("train/success", "eval/success"), "success"),
    (("train/return", "eval/return"), "return"),
    (("time/steps_per_s",), "steps/s"),
)
"""Metrics of each panel, and its label; those of evaluations are drawn with markers."""

STAGE = "train/stage/"
"""Prefix of the shares of episodes that reached a stage of a task; of the first run."""

PANEL_IN, DPI = (4.0, 3.6), 120
CARD_SIZE_IN, CARD_DPI = (6.0, 3.2), 90
Line = Sequence[tuple[float, float]]


def run(options: PlotCommand) -> int:
    """Draws the picture."""
    if not options.runs:
        raise OptionError("Give at least one folder of a run.")
    out = options.runs[0] / "curves.png" if options.out is None else options.out
    # The default file is the run's own, and is drawn again as the run goes on.
    check_file(out, force=options.force or options.out is None)
    draw_curves(options.runs, out, minutes=options.minutes)
    tell(f"wrote {out}")
    return 0


def draw_curves(runs: Sequence[Path], out: Path, *, minutes: bool = False) -> None:
    """Draws the curves of runs over their steps, one colour each; of a task, also its stages.

    Args:
        runs: Folders of runs.
        out: The picture.
        minutes: Whether to draw over wall time, which includes that of a warm start.

    Raises:
        PolicyFileError: A folder holds no run, or one without an update.
    """
    read = [over_minutes(run) if minutes else _entries(run) for run in runs]
    over = "minutes" if minutes else "environment steps"
    stages = [name for name in read[0][-1] if name.startswith(STAGE)]
    count = len(PANELS) + bool(stages)
    figure = _figure((count * PANEL_IN[0], PANEL_IN[1]))
    axes = figure.subplots(1, count)
    for number, (run, entries) in enumerate(zip(runs, read, strict=True)):
        for axis, (metrics, _) in zip(axes, PANELS, strict=False):
            for metric in metrics:
                line = [(entry["steps"], entry[metric]) for entry in entries if metric in entry]
                evaluated = metric.startswith("eval/")
                _draw(axis, line, evaluated=evaluated, label=f"{run.name}, ", color=f"C{number}")
    for axis, (_, label) in zip(axes, PANELS, strict=False):
        _name(axis, label, over)
    axes[0].set_ylim(0, 1)
    axes[0].legend(fontsize="small")
    if stages:
        _draw_stages(axes[-1], read[0], stages, over)
    _save(figure, out, DPI)


def _entries(run: Path) -> list[dict[str, Any]]:
    entries = read_progress(run)
    if not entries:
        raise PolicyFileError(f"{run} has no {FILE} with an update.")
    return entries


def over_minutes(run: Path) -> list[dict[str, Any]]:
    """Returns the entries of a run with minutes in place of its steps."""
    cloned = run / CLONED
    began_s = checkpoint.load(cloned)[1]["seconds"] if cloned.is_file() else 0.0
    return [one | {"steps": (began_s + one["seconds"]) / 60} for one in _entries(run)]


def _draw_stages(
    axis: Any, entries: Sequence[dict[str, Any]], stages: Sequence[str], over: str
) -> None:
    for name in stages:
        line = [(entry["steps"], entry[name]) for entry in entries if name in entry]
        axis.plot(*zip(*line, strict=True), label=name.removeprefix(STAGE))
    _name(axis, "episodes that reached the stage", over)
    axis.set_ylim(0, 1)
    axis.legend(fontsize="small", ncols=2)


def draw_success(training: Line, evaluated: Line, out: Path) -> None:
    """Draws (steps, success rate) of training and of evaluations, for a model card."""
    figure = _figure(CARD_SIZE_IN)
    axis = figure.subplots()
    _draw(axis, training, evaluated=False)
    _draw(axis, evaluated, evaluated=True)
    _name(axis, "success")
    axis.set_ylim(0, 1)
    axis.legend(fontsize="small")
    _save(figure, out, CARD_DPI)


def _figure(size_in: tuple[float, float]) -> Any:
    return Figure(figsize=size_in, layout="constrained")


def _draw(axis: Any, line: Line, *, evaluated: bool, label: str = "", **style: Any) -> None:
    if not line:
        return
    style |= {"marker": "o"} if evaluated else {"alpha": 0.5}
    label += "validation" if evaluated else "training"
    axis.plot(*zip(*line, strict=True), label=label, **style)


def _name(axis: Any, label: str, over: str = "environment steps") -> None:
    axis.set(xlabel=over, ylabel=label)
    axis.grid(alpha=0.3)


def _save(figure: Any, out: Path, dpi: int) -> None:
    """Writes a picture that is the same for the same curves."""
    with written_aside(out) as scratch:
        figure.savefig(scratch, format="png", dpi=dpi, metadata={"Software": None})
