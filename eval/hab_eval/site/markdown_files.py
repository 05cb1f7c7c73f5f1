"""Markdown files as parts of pages: model cards and studies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlsplit

from markdown_it import MarkdownIt
from markdown_it.token import Token
from markupsafe import Markup

from hab_eval.errors import ResultError

PICTURE_TYPES = {".png", ".jpg", ".jpeg", ".webp"}


@dataclass(frozen=True, kw_only=True)
class MarkdownFile:
    """A Markdown file; pictures that it shows are beside it."""

    path: Path
    text: str

    @property
    def pictures(self) -> list[str]:
        """Names of the pictures that it shows."""
        return list(dict.fromkeys(rendered(self, "")[1]))


def read_markdown(path: Path) -> MarkdownFile:
    """Reads a Markdown file.

    Raises:
        ResultError: It cannot be read.
    """
    try:
        return MarkdownFile(path=path, text=path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ResultError(f"{path}: cannot be read: {error}") from error


def title_of(file: MarkdownFile) -> str:
    """Returns the heading in the first line; the name of the folder without one."""
    first = file.text.partition("\n")[0]
    return first.removeprefix("# ").strip() if first.startswith("# ") else file.path.parent.name


def rendered(file: MarkdownFile, folder: str) -> tuple[Markup, list[str]]:
    """Returns the HTML of a file, and the names of the pictures beside it that it shows.

    The page, which has its own title, finds the pictures in `folder`, as WebP.

    Raw HTML is shown as text. Other pictures are left out, so that a page loads nothing from a
    network, and relative links become text, because the site does not contain their targets.
    """
    parser = MarkdownIt("commonmark", {"html": False}).enable(["table", "strikethrough"])
    tokens = _without_title(parser.parse(file.text))
    pictures: list[str] = []
    for token in tokens:
        _lower_heading(token)
        for child in token.children or []:
            if child.type == "image":
                _localize(child, file.path.parent, folder, pictures)
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
