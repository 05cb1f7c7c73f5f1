"""Agents of the submissions, and model cards of their policies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlsplit

from markdown_it import MarkdownIt
from markdown_it.token import Token
from markupsafe import Markup

from hab_eval.errors import ResultError
from hab_eval.site.entries import Entry, unique_slugs

CARDS = "baselines/*/*/weights/*.md"
PICTURE_TYPES = {".png", ".jpg", ".jpeg", ".webp"}


@dataclass(frozen=True, kw_only=True)
class Card:
    """A model card.

    Attributes:
        agent: The agent that loads the policy, ``module:factory``.
        path: The Markdown file.
        text: Its content.
    """

    agent: str
    path: Path
    text: str


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
    cards = []
    for path in sorted(checkout.glob(CARDS)):
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, ValueError) as error:
            raise ResultError(f"{path}: cannot be read: {error}") from error
        cards.append(Card(agent=f"{path.parent.parent.name}:{path.stem}", path=path, text=text))
    return cards


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


def rendered(card: Card, folder: str) -> tuple[Markup, list[str]]:
    """Returns the HTML of a card, and the names of the pictures beside it that it shows.

    The page, which has its own title, finds the pictures in `folder`, as WebP.

    Raw HTML is shown as text. Other pictures are left out, so that a page loads nothing from a
    network, and relative links become text, because the site does not contain their targets.
    """
    parser = MarkdownIt("commonmark", {"html": False}).enable(["table", "strikethrough"])
    tokens = _without_title(parser.parse(card.text))
    pictures: list[str] = []
    for token in tokens:
        _lower_heading(token)
        for child in token.children or []:
            if child.type == "image":
                _localize(child, card.path.parent, folder, pictures)
        if token.children:
            token.children = _without_relative_links(token.children)
    return Markup(parser.renderer.render(tokens, parser.options, {})), pictures


def _without_title(tokens: list[Token]) -> list[Token]:
    """Removes a heading of the first level at the start."""
    is_title = bool(tokens) and tokens[0].type == "heading_open" and tokens[0].tag == "h1"
    return tokens[3:] if is_title else tokens  # opening, text, closing


def _lower_heading(token: Token) -> None:
    """Moves headings down by one level; the page has its own title."""
    if token.type in ("heading_open", "heading_close"):
        token.tag = f"h{min(6, int(token.tag[1:]) + 1)}"


def _localize(image: Token, beside: Path, folder: str, pictures: list[str]) -> None:
    """Points an image to its copy in the site, or turns it into text."""
    name = unquote(str(image.attrs.get("src", "")))
    is_beside = name == Path(name).name and (beside / name).is_file()
    if is_beside and Path(name).suffix.lower() in PICTURE_TYPES:
        pictures.append(name)
        image.attrs["src"] = f"{folder}/{Path(name).stem}.webp"
        image.attrs["loading"] = "lazy"
    else:
        image.type, image.tag, image.nesting = "text", "", 0


def _without_relative_links(children: list[Token]) -> list[Token]:
    kept, dropped = [], 0
    for child in children:
        if child.type == "link_open":
            if urlsplit(str(child.attrs.get("href", ""))).scheme in ("http", "https"):
                child.attrs["rel"] = "noreferrer"
            else:
                dropped += 1
                continue
        elif child.type == "link_close" and dropped:
            dropped -= 1
            continue
        kept.append(child)
    return kept
