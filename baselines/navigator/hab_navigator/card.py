"""The model card of the navigator that ships, made from its file and its evaluations."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from hab_eval.records.results import RunRecord
from hab_ppo.cards import NOT_EVALUATED, result, table

from hab_navigator.network import NAVIGATOR, is_run, load, ship, shipped_navigator
from hab_tasks.skills.navigate import NAVIGATE_ID

__all__ = ["card", "cards", "is_run", "ship"]

ABOUT = "Navigate with a map, a learned distribution of the goal pose, and planned paths."
ROUNDS = (
    "round",
    "train layouts of",
    "episodes",
    "solved %",
    "lessons",
    "cross-entropy before",
    "after fit",
)


def cards(records: Iterable[RunRecord]) -> dict[Path, str]:
    """Returns the file and the text of the card; nothing if no weights ship."""
    path = shipped_navigator()
    return {path.with_suffix(".md"): card(records)} if path.is_file() else {}


def card(records: Iterable[RunRecord]) -> str:
    """Returns the text of the card.

    Args:
        records: Evaluations; those of other agents, or with options, are left out.
    """
    path = shipped_navigator()
    _, about = load(path)
    own = [r for r in records if r.agent == f"hab_ppo:{NAVIGATOR}" and not r.options]
    play = f"`hab-eval run --agent hab_ppo:{NAVIGATOR} --env {NAVIGATE_ID} --out DIR`"
    lines = [f"# {NAVIGATOR}", "", ABOUT, "", f"- Run: {play}"]
    lines += [f"- Weights: {path.stat().st_size / 1e6:.1f} MB", *_training(about)]
    lines += ["", *table(ROUNDS, _rounds(about)), ""]
    lines += ["Success % [95 % interval], failures:", ""]
    lines += [result(r) for r in own] or [NOT_EVALUATED]
    return "\n".join(lines) + "\n"


def _training(about: dict[str, Any]) -> list[str]:
    origin = about["origin"]
    # A run may have gone on with another command; rounds of an earlier format do not tell theirs.
    told = dict.fromkeys(found.get("command", origin["command"]) for found in about["rounds"])
    commands = ", then ".join(f"`{command}`" for command in told)
    return [
        f"- Trained: {commands} (commit {str(origin['git'])[:8]})",
        f"- Time: {about['seconds'] / 60:.0f} min ({origin['device']})",
    ]


def _rounds(about: dict[str, Any]) -> list[tuple[str, ...]]:
    return [
        (
            str(number),
            found["scene_dataset"],
            str(found["episodes"]),
            f"{100 * found['solved'] / found['episodes']:.1f}",
            f"{found['lessons']:,}",
            f"{found['misfit_of_new']:.2f}",
            f"{found['misfit_after']:.2f}",
        )
        for number, found in enumerate(about["rounds"], 1)
    ]
