"""Paired comparison of two runs on their common episodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from hab_eval.errors import ResultError
from hab_eval.records.leaderboard import agent_label, group_title
from hab_eval.records.plain_text import add_row
from hab_eval.records.results import EpisodeResult, RunRecord, outcome_of, video_name
from hab_eval.records.stats import exact_mcnemar

FEWEST_COMMON = 2


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Outcomes of two runs on their common episodes.

    Attributes:
        first: Index of the first run in its set.
        second: Index of the second run.
        n: Number of common episodes.
        both: Number of episodes that both solve.
        only_first: Number of episodes that only the first run solves.
        only_second: Number of episodes that only the second run solves.
        p_value: Of McNemar's exact test, two-sided.
    """

    first: int
    second: int
    n: int
    both: int
    only_first: int
    only_second: int
    p_value: float

    @property
    def difference(self) -> float:
        """Success rate of the first run minus that of the second."""
        return (self.only_first - self.only_second) / self.n


def compare(first: RunRecord, second: RunRecord, indices: tuple[int, int] = (0, 1)) -> Pair | None:
    """Compares two runs on their common episodes; None if there are too few."""
    a = {one.id: one.success for one in first.episodes}
    b = {one.id: one.success for one in second.episodes}
    common = a.keys() & b.keys()
    if len(common) < FEWEST_COMMON:
        return None
    only_first = sum(a[name] and not b[name] for name in common)
    only_second = sum(b[name] and not a[name] for name in common)
    return Pair(
        first=indices[0],
        second=indices[1],
        n=len(common),
        both=sum(a[name] and b[name] for name in common),
        only_first=only_first,
        only_second=only_second,
        p_value=exact_mcnemar(only_first, only_second),
    )


def pair_of(records: Sequence[RunRecord]) -> Pair:
    """Compares two runs.

    Raises:
        ResultError: They have too few common episodes.
    """
    first, second = records
    pair = compare(first, second)
    if pair is None:
        titles = [f"{group_title(one)}, {one.split}, seed {one.seed}" for one in records]
        raise ResultError(
            f"The runs have no common episodes: {titles[0]}; {titles[1]}. Run both agents with the "
            "same --env, --scene-dataset, --split and --seed."
        )
    return pair


def summary(records: Sequence[RunRecord], pair: Pair) -> str:
    """Returns the comparison in words."""
    a, b = (agent_label(one) for one in records)
    neither = pair.n - pair.both - pair.only_first - pair.only_second
    return (
        f"A: {a}\nB: {b}\n{pair.n} common episodes: {pair.both} solved by both, "
        f"{pair.only_first} by A only, {pair.only_second} by B only, {neither} by neither.\n"
        f"Success of A minus B: {100.0 * pair.difference:+.1f} % points; "
        f"McNemar's exact test, two-sided: p = {pair.p_value:.3g}."
    )


def difference_table(records: Sequence[RunRecord], folders: Sequence[Path]) -> Table:
    """Returns the episodes that only one of two runs solves, with the videos in their folders."""
    theirs = [{one.id: (k, one) for k, one in enumerate(record.episodes)} for record in records]
    table = Table(title="Episodes with another outcome")
    for column in ("episode", "scene", "A", "B", "videos"):
        table.add_column(column, overflow="fold")
    for name in (one.id for one in records[0].episodes if one.id in theirs[1]):
        found = [of_run[name] for of_run in theirs]
        a, b = (episode for _, episode in found)
        if a.success == b.success:
            continue
        videos = [
            folder / f"{video_name(k, name)}.mp4"
            for folder, (k, _) in zip(folders, found, strict=True)
        ]
        shown = [str(video) for video in videos if video.is_file()]
        add_row(table, name, a.scene, _told(a), _told(b), "\n".join(shown) or "-")
    return table


def _told(episode: EpisodeResult) -> str:
    return f"{outcome_of(episode)}, {episode.steps} steps"
