"""Escaping of free text of agents and submissions for terminal, Markdown, HTML and matplotlib."""

from __future__ import annotations

import html
import re
import sys

from rich.console import Console
from rich.table import Table

LOG_WIDTH = 140
"""Width of a table [characters] if the output is not a terminal."""

MARKDOWN_MARKS = re.compile(
    r"[\\`*~$|#]|(?<![^\W_])_|_(?![^\W_])|(?<=\])[\[(]|(?<=:)/|(?<=www)\.|@"
)
"""Inline markup of Markdown and GitHub.

Underscores inside a word and brackets without a link target are not markup and stay unescaped.
"""


def plain(text: str) -> str:
    """Returns text on one line, with non-printable characters and line breaks escaped."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def markdown(text: str) -> str:
    """Escapes text for Markdown headings and tables."""
    safe = html.escape(plain(text), quote=False)
    return MARKDOWN_MARKS.sub(r"\\\g<0>", safe)


def markup(text: str) -> str:
    """Escapes text for HTML."""
    return html.escape(plain(text))


def figure_text(text: str) -> str:
    """Escapes text for matplotlib: no mathtext, and no leading underscore, which hides a label."""
    safe = plain(text).replace("$", r"\$")
    return f" {safe}" if safe.startswith("_") else safe


def show(table: Table) -> None:
    """Prints a table without markup, as wide as the terminal or `LOG_WIDTH`."""
    width = None if sys.stdout.isatty() else LOG_WIDTH
    Console(width=width, markup=False, emoji=False, highlight=False).print(table)


def add_row(table: Table, *cells: str) -> None:
    """Adds a row of escaped text."""
    table.add_row(*map(plain, cells))
