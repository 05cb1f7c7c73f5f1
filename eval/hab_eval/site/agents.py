"""Agents of the submissions, and model cards of their policies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hab_eval.site.entries import Entry, unique_slugs
from hab_eval.site.markdown_files import MarkdownFile, read_markdown

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
