"""The pages of the site: path, template, and what each template shows."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hab_eval.records import paper
from hab_eval.records.leaderboard import FEW_EPISODES
from hab_eval.records.results import RunRecord, highlights, outcome_of
from hab_eval.records.status import BEST_COLUMNS
from hab_eval.site.agents import AgentPage, Study
from hab_eval.site.breakdown import Receptacles, by_layout, by_receptacle, histogram
from hab_eval.site.comparison import ComparisonSet
from hab_eval.site.datasets import DatasetPage
from hab_eval.site.entries import (
    DATASET_NOTE,
    Entry,
    command_lines,
    counterparts,
    dataset_rank,
    env_rank,
    facts_of,
    needs_path,
    verify_command,
)
from hab_eval.site.media import Video, View, rendered

MOST_PAIRS = 10
"""Pairs of a set in the list of comparisons; the set's own page has all."""

Partners = Mapping[str, Sequence[tuple[ComparisonSet, Entry, Entry]]]
"""Name of a submission -> (set, first run, second run) of its comparisons."""


@dataclass(frozen=True)
class Page:
    """A page of the site.

    Attributes:
        path: File, relative to the site's folder.
        template: File name of the template.
        section: Entry of the navigation that is highlighted.
        title: Title of the page.
        context: Values for the template.
        data: Values for the page's script, as JSON.
    """

    path: str
    template: str
    section: str
    title: str
    context: Mapping[str, Any] = field(default_factory=dict)
    data: Any = None


@dataclass(frozen=True, kw_only=True)
class Site:
    """Everything that the pages show.

    Attributes:
        entries: The submissions, in the order of the leaderboard.
        sets: Runs that can be compared on the same episodes.
        agents: Agents with submissions or a model card.
        datasets: Scene datasets of the submissions.
        studies: Studies of the checkout.
        receptacles: Receptacles of known episodes.
        videos: Name of a submission -> its videos.
        views: Name of a submission -> its pages in 3-D.
        docs: Folder of the datasets' figures.
        best: Environment -> its best results, as `hab_eval.records.status.best_rows`.
    """

    entries: Sequence[Entry]
    sets: Sequence[ComparisonSet]
    agents: Sequence[AgentPage]
    datasets: Sequence[DatasetPage]
    studies: Sequence[Study]
    receptacles: Receptacles
    videos: Mapping[str, Sequence[Video]]
    views: Mapping[str, Sequence[View]]
    docs: Path
    best: Sequence[tuple[str, Sequence[RunRecord | str]]] = ()

    @functools.cached_property
    def agent_slugs(self) -> dict[str, str]:
        """Agent -> slug of its page."""
        return {one.agent: one.slug for one in self.agents}


def all_pages(site: Site) -> list[Page]:
    """Returns every page."""
    partners = _partners(site)
    return [
        _overview(site),
        _leaderboard(site),
        *(_run(site, entry, partners) for entry in site.entries),
        _comparisons(site),
        *(_comparison(one) for one in site.sets),
        _agents(site),
        *(_agent(one) for one in site.agents),
        _datasets(site),
        *(_dataset(one) for one in site.datasets),
        _studies(site),
        _paper(site),
    ]


def _overview(site: Site) -> Page:
    """Returns the front page: the best result of every environment, with a link to its run."""
    entries = {id(entry.record): entry for entry in site.entries}
    rows = [(env, [(entries.get(id(one)), one) for one in best]) for env, best in site.best]
    title = "Home Assistant Benchmark"
    return Page(
        path="index.html",
        template="overview.html",
        section="overview",
        title=title,
        context={"columns": list(BEST_COLUMNS), "rows": rows},
    )


def _leaderboard(site: Site) -> Page:
    records = [entry.record for entry in site.entries]
    filters = {
        "env": sorted({record.env for record in records}, key=env_rank),
        "scenes": sorted({entry.scenes for entry in site.entries}, key=dataset_rank),
        "split": sorted({record.split for record in records}),
        "kind": sorted({kind for entry in site.entries for kind in entry.kinds}),
    }
    return Page(
        path="leaderboard.html",
        template="leaderboard.html",
        section="leaderboard",
        title="Leaderboard",
        context={
            "entries": site.entries,
            "filters": filters,
            "few_episodes": FEW_EPISODES,
        },
        data={entry.slug: _rerun(entry) for entry in site.entries},
    )


def _rerun(entry: Entry) -> dict[str, Any]:
    return {
        "commands": command_lines(entry),
        "verify": verify_command(entry),
        "note": DATASET_NOTE if needs_path(entry.record) else "",
        "facts": facts_of(entry),
    }


def _run(site: Site, entry: Entry, partners: Partners) -> Page:
    record = entry.record
    episodes = record.episodes
    videos = {video.index: video for video in site.videos.get(entry.name, ())}
    shown = [videos[index] for index in highlights(record) if index in videos]
    context = {
        "entry": entry,
        "record": record,
        "rerun": _rerun(entry),
        "layouts": by_layout(record),
        "receptacles": by_receptacle(record, site.receptacles),
        "failures": list(record.summary.failures.items()),
        "videos": videos,
        "views": {view.index: view for view in site.views.get(entry.name, ())},
        "shown_videos": [(video, episodes[video.index]) for video in shown],
        "outcomes": sorted({outcome_of(one) for one in episodes}),
        "paper": [one for one in paper.RESULTS if counterparts(one, [entry])],
        "comparisons": partners.get(entry.name, ()),
        "agent_slug": site.agent_slugs[record.agent],
        "dataset_slug": next(d.slug for d in site.datasets if d.name == record.scene_dataset),
    }
    data = {
        "return": histogram(record, [one.episode_return for one in episodes]),
        "steps": histogram(record, [float(one.steps) for one in episodes]),
    }
    title = f"{record.agent_name} on {record.env}, {entry.scenes}"
    path = f"runs/{entry.slug}.html"
    return Page(
        path=path,
        template="run.html",
        section="leaderboard",
        title=title,
        context=context,
        data=data,
    )


def _partners(site: Site) -> Partners:
    found: dict[str, list[tuple[ComparisonSet, Entry, Entry]]] = {}
    for one in site.sets:
        for pair in one.pairs:
            first, second = one.entries[pair.first], one.entries[pair.second]
            found.setdefault(first.name, []).append((one, first, second))
            found.setdefault(second.name, []).append((one, first, second))
    return found


def _comparisons(site: Site) -> Page:
    context = {"sets": site.sets, "most_pairs": MOST_PAIRS}
    return _page("compare", "index", "comparisons", "Paired comparisons", **context)


def _comparison(one: ComparisonSet) -> Page:
    title = f"Comparison on {one.title}"
    return _page("compare", one.slug, "comparison", title, data=one.data(), set=one)


def _agents(site: Site) -> Page:
    return _page("agents", "index", "agents", "Agents", agents=site.agents)


def _agent(agent: AgentPage) -> Page:
    card = None if agent.card is None else rendered(agent.card.file, agent.slug)[0]
    return _page("agents", agent.slug, "agent", agent.name, agent=agent, card=card)


def _datasets(site: Site) -> Page:
    return _page("datasets", "index", "datasets", "Datasets", datasets=site.datasets)


def _dataset(dataset: DatasetPage) -> Page:
    return _page("datasets", dataset.slug, "dataset", dataset.name, dataset=dataset)


def _studies(site: Site) -> Page:
    texts = [(one, rendered(one.file, f"studies/{one.slug}")[0]) for one in site.studies]
    return _page("studies", "", "studies", "Studies", studies=texts)


def _paper(site: Site) -> Page:
    rows = [(result, counterparts(result, site.entries)) for result in paper.RESULTS]
    title = "Comparison with the paper"
    return _page("paper", "", "paper", title, rows=rows, not_comparable=paper.NOT_COMPARABLE)


def _page(
    section: str, name: str, template: str, title: str, data: Any = None, **context: Any
) -> Page:
    """Returns a page of a section's folder, or the section's only page if `name` is empty."""
    path = f"{section}/{name}.html" if name else f"{section}.html"
    return Page(path, f"{template}.html", section, title, context, data)
