"""Report of repeated episodes for the terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from rich.table import Table

from hab_eval.records import provenance
from hab_eval.records.config import MOST_EPISODES
from hab_eval.records.plain_text import add_row, plain
from hab_eval.records.results import EpisodeResult, RunRecord
from hab_eval.run.replay import Difference, episode_differences
from hab_tasks.errors import shown
from hab_tasks.option_values import LARGEST_SEED, whole

IDENTICAL, SAME, DIFFERENT = LEVELS = ("identical", "with the same outcome and steps", "different")
"""How far a repeated episode agrees with its record."""


def draw(total: int, count: int, seed: int) -> tuple[int, ...]:
    """Returns the indices of `count` different episodes, in order; all if there are fewer."""
    whole("episodes", count, 1, MOST_EPISODES)
    whole("sample-seed", seed, 0, LARGEST_SEED)
    drawn = np.random.default_rng(seed).choice(total, size=min(count, total), replace=False)
    return tuple(sorted(int(index) for index in drawn))


def comparison_table(
    name: str, recorded: Sequence[EpisodeResult], repeated: Sequence[EpisodeResult]
) -> Table:
    """Returns a table with one row per repeated episode."""
    table = Table(title=plain(f"{name}: recorded -> repeated"))
    for column in ("episode", "outcome", "steps", "return", ""):
        table.add_column(column, overflow="fold")
    for old, new in zip(recorded, repeated, strict=True):
        verdict = level_of(episode_differences(old, new))
        pairs = [
            (old.failure or "success", new.failure or "success"),
            (str(old.steps), str(new.steps)),
            (f"{old.episode_return:.4f}", f"{new.episode_return:.4f}"),
        ]
        cells = [a if a == b else f"{a} -> {b}" for a, b in pairs]
        add_row(table, old.id, *cells, verdict)
    return table


def level_of(differences: Sequence[Difference]) -> str:
    """Returns how far a repeated episode agrees with its record."""
    if all(one.small for one in differences):
        return SAME if differences else IDENTICAL
    return DIFFERENT


def closing_lines(record: RunRecord, count: int, differences: Sequence[Difference]) -> list[str]:
    """Returns what is different, and a summary, with commits and machines if there are any."""
    lines = []
    for one in differences:
        where = f"episode {one.episode}" if one.episode else "agent"
        values = f"recorded {shown(one.recorded)}, repeated {shown(one.repeated)}"
        if not one.small:  # the table names the others
            lines.append(plain(f"different: {where}: {one.name}: {values}"))
    by_episode: dict[str, list[Difference]] = {}
    for one in differences:
        by_episode.setdefault(one.episode, []).append(one)
    affected = Counter(level_of(found) for name, found in by_episode.items() if name)
    counts = {IDENTICAL: count - affected.total(), **affected}
    told = ", ".join(f"{counts[one]} {one}" for one in LEVELS if counts.get(one))
    summary = f"{count} episodes repeated: {told}"
    if not differences:
        return [f"{summary}."]
    before = f"recorded at commit {record.git or 'unknown'} on {record.device}"
    now = f"repeated at commit {provenance.git_commit() or 'unknown'} on {provenance.device()}"
    return [*lines, plain(f"{summary}; {before}, {now}.")]
