"""Weights that ship with the package: one file each, which also tells how it was trained.

The description in the file's header holds all that a model card needs but its results: recipe,
command, machine, commit, time, what it was cloned from, and the learning curve.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hab_ppo import checkpoint
from hab_ppo.agent import WEIGHTS, weights_file
from hab_ppo.checkpoint import PolicyFileError
from hab_ppo.commands import ShipCommand
from hab_ppo.extensions import extensions
from hab_ppo.plan import CLONED
from hab_ppo.progress import read_progress
from hab_tasks.io.console import tell

CURVE_POINTS = 100
"""Most points of the training curve that are kept; evaluations are all kept."""

NUMBERS = 4
"""Decimal places of a curve's values."""


@dataclass(frozen=True, kw_only=True)
class Point:
    """A point of a learning curve.

    Attributes:
        steps: Environment steps.
        training: Success rate of the last training episodes; None if none had ended.
        evaluated: Success rate of an evaluation; None without one.
    """

    steps: int
    training: float | None
    evaluated: float | None


def run(options: ShipCommand) -> int:
    """Writes the file of weights."""
    others = [found.load() for found in extensions("shipping").values()]
    found = next((one for one in others if one.is_run(options.run_folder)), None)
    out = (ship if found is None else found.ship)(options.run_folder)
    tell(f"wrote {out}, {out.stat().st_size / 1e6:.1f} MB; hab-ppo cards writes its card")
    return 0


def ship(run: Path) -> Path:
    """Writes the best weights of a run to the package's folder; returns the file.

    Raises:
        PolicyFileError: The folder holds no run, or weights that do not tell their origin.
    """
    source = weights_file(run)
    tensors, about = checkpoint.load(source)
    for entry in ("origin", "recipe", "position"):
        if entry not in about:
            raise PolicyFileError(f"{source} does not tell its {entry}; train it again.")
    entries = read_progress(run)
    if not entries:
        raise PolicyFileError(f"{run} has no progress.jsonl with an update.")
    cloned = run / CLONED
    start = checkpoint.load(cloned)[1] if cloned.is_file() else None
    description = {name: value for name, value in about.items() if name != "format"}
    description["training"] = {
        "steps": entries[-1]["steps"],
        "seconds": entries[-1]["seconds"],
        "start": None if start is None else {k: start[k] for k in ("seconds", "made_from")},
        "curve": [[p.steps, p.training, p.evaluated] for p in curve(entries)],
    }
    out = WEIGHTS / f"{about['recipe']['name']}.safetensors"
    out.parent.mkdir(exist_ok=True)
    network = {name: value for name, value in tensors.items() if name.startswith("network/")}
    checkpoint.save(out, network, description)
    return out


def curve(entries: list[dict[str, Any]]) -> list[Point]:
    """Returns the learning curve of the entries of a progress file, thinned out."""
    stride = max(1, -(-len(entries) // CURVE_POINTS))
    points = []
    for number, entry in enumerate(entries):
        evaluated = entry.get("eval/success")
        if evaluated is not None or number % stride == 0:
            training = _rounded(entry.get("train/success"))
            points.append(
                Point(steps=entry["steps"], training=training, evaluated=_rounded(evaluated))
            )
    return points


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, NUMBERS)
