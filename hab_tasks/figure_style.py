"""Style and output of all figures: no display needed, reproducible bytes.

Colours are Okabe and Ito's palette for colour-blind readers; markers, hatches or words repeat the
information of colours.
"""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from hab_tasks.io.files import written_aside

BLUE, ORANGE, GREEN, VERMILION = "#0072B2", "#E69F00", "#009E73", "#D55E00"
EDGE = "#6B7075"
DPI = 150


def new_figure(width_in: float, height_in: float) -> Figure:
    """Returns an empty figure that needs no display."""
    figure = Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, file: Path) -> None:
    """Writes a PNG atomically; equal figures give equal bytes."""
    with written_aside(file) as scratch:
        figure.savefig(scratch, metadata={"Software": None})


def bare(axes: Axes) -> None:
    """Removes the parts of the frame that are not needed to read the axes."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(axis="both", length=2.5)
    axes.tick_params(axis="x", labelsize=8)
