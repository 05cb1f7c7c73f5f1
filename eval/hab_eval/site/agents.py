"""Agents of the submissions, and model cards of their policies; studies with their runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hab_eval.records.leaderboard import read_submissions
from hab_eval.site.entries import Entry, make_entries, unique_slugs
from hab_eval.site.media import MarkdownFile, read_markdown, title_of

CARDS = "baselines/*/*/weights/*.md"


@dataclass(frozen=True, kw_only=True)
class Card:
    """A model card.

    Attributes:
        agent: The agent that loads the policy, ``module:factory``.
        file: The card.
    """

    agent: str
    file: MarkdownFile


@dataclass(frozen=True, kw_only=True)
class AgentPage:
    """An agent with its submissions and its model card, if any."""

    agent: str
    slug: str
    name: str
    kinds: tuple[str, ...]
    entries: tuple[Entry, ...]
    card: Card | None


def read_cards(checkout: Path) -> list[Card]:
    """Reads the model cards of a checkout; the agent is named after package and file.

    Raises:
        ResultError: A card cannot be read.
    """
    return [
        Card(agent=f"{path.parent.parent.name}:{path.stem}", file=read_markdown(path))
        for path in sorted(checkout.glob(CARDS))
    ]


def agent_pages(entries: Sequence[Entry], cards: Sequence[Card]) -> list[AgentPage]:
    """Returns a page for every agent that has submissions or a model card."""
    by_agent: dict[str, list[Entry]] = {}
    for entry in entries:
        by_agent.setdefault(entry.record.agent, []).append(entry)
    card_of = {card.agent: card for card in cards}
    agents = sorted(by_agent.keys() | card_of.keys())
    pages = []
    for agent, slug in zip(agents, unique_slugs(agents), strict=True):
        own = by_agent.get(agent, [])
        pages.append(
            AgentPage(
                agent=agent,
                slug=slug,
                name=own[0].record.agent_name if own else agent.partition(":")[2],
                kinds=tuple(sorted({kind for entry in own for kind in entry.kinds}))
                or ("learned",),  # a card without submissions
                entries=tuple(own),
                card=card_of.get(agent),
            )
        )
    return pages


STUDIES = "eval/studies/*/README.md"


@dataclass(frozen=True, kw_only=True)
class Study:
    """A study.

    Attributes:
        slug: Name as part of file names and links.
        title: Heading of its text.
        file: Its text.
        entries: Its runs, which are not on the leaderboard.
    """

    slug: str
    title: str
    file: MarkdownFile
    entries: Sequence[Entry]


def read_studies(checkout: Path) -> list[Study]:
    """Reads the studies of a checkout.

    Raises:
        ResultError: A file cannot be read, or is not a valid result.
    """
    files = [read_markdown(path) for path in sorted(checkout.glob(STUDIES))]
    slugs = unique_slugs(file.path.parent.name for file in files)
    return [
        Study(
            slug=slug,
            title=title_of(file),
            file=file,
            entries=make_entries(read_submissions(file.path.parent)),
        )
        for file, slug in zip(files, slugs, strict=True)
    ]
