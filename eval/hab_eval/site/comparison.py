"""Sets of runs on the same episodes, for their paired comparison."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

from hab_eval.records.leaderboard import group_title
from hab_eval.records.paired import Pair, compare
from hab_eval.records.results import outcome_of
from hab_eval.site.entries import Entry, unique_slugs

MOST_COMPARED = 100
"""Runs of a set that are compared, the best ones; pairs grow with the square of their number."""


@dataclass(frozen=True, kw_only=True)
class ComparisonSet:
    """Runs on the same environment, datasets and episodes.

    Attributes:
        title: Environment, datasets, split and seed.
        slug: The title as a file name.
        entries: The runs, the best first; the others of the episodes are in no pair.
        pairs: All pairs with common episodes.
    """

    title: str
    slug: str
    entries: tuple[Entry, ...]
    pairs: tuple[Pair, ...]

    def data(self) -> dict[str, Any]:
        """Returns what the page's script shows: episodes, outcomes and pairs."""
        ids = dict.fromkeys(one.id for entry in self.entries for one in entry.record.episodes)
        scenes = {one.id: one.scene for entry in self.entries for one in entry.record.episodes}
        return {
            "episodes": list(ids),
            "scenes": [scenes[name] for name in ids],
            "runs": [_run_data(entry, list(ids)) for entry in self.entries],
            "pairs": [
                [p.first, p.second, p.n, p.both, p.only_first, p.only_second, p.p_value]
                for p in self.pairs
            ],
        }


def comparison_sets(entries: Sequence[Entry]) -> list[ComparisonSet]:
    """Groups runs that share episodes; a set has at least one pair."""
    groups: dict[tuple[str, str], list[Entry]] = {}
    for entry in entries:
        prefix = entry.record.episodes[0].id.rpartition("/")[0]
        groups.setdefault((group_title(entry.record), prefix), []).append(entry)
    found: list[tuple[str, list[Entry], tuple[Pair, ...]]] = []
    for runs in groups.values():
        group = runs[:MOST_COMPARED]
        numbered = combinations(enumerate(group), 2)
        pairs = [compare(a.record, b.record, (i, j)) for (i, a), (j, b) in numbered]
        kept = tuple(pair for pair in pairs if pair is not None)
        if kept:
            found.append((_title(group[0]), group, kept))
    slugs = unique_slugs(title for title, _, _ in found)
    return [
        ComparisonSet(title=title, slug=slug, entries=tuple(group), pairs=pairs)
        for slug, (title, group, pairs) in zip(slugs, found, strict=True)
    ]


def _title(entry: Entry) -> str:
    record = entry.record
    return f"{group_title(record)}, {record.split}, seed {record.seed}"


def _run_data(entry: Entry, ids: Sequence[str]) -> dict[str, Any]:
    """Returns a run's outcome, as an index of its `outcomes`, and steps for each episode."""
    by_id = {one.id: one for one in entry.record.episodes}
    outcomes = list(dict.fromkeys(["success", *map(outcome_of, entry.record.episodes)]))
    known = {name: number for number, name in enumerate(outcomes)}
    return {
        "slug": entry.slug,
        "outcomes": outcomes,
        "outcome": [known[outcome_of(by_id[name])] if name in by_id else None for name in ids],
        "steps": [by_id[name].steps if name in by_id else None for name in ids],
    }
