"""Free text of agents and submissions is shown as it is: it is no markup of any kind."""

from __future__ import annotations

import html
import re
import sys

from rich.console import Console
from rich.table import Table

LOG_WIDTH = 140
"""Characters of a table that goes into a file or a pipe, where no terminal gives a width."""

MARKDOWN_MARKS = re.compile(
    r"[\\`*~$|#]|(?<![^\W_])_|_(?![^\W_])|(?<=\])[\[(]|(?<=:)/|(?<=www)\.|@"
)
"""What Markdown and GitHub take for markup in the middle of a line.

An underscore inside of a word and brackets that no target follows are none, and stay readable.
"""


def plain(text: str) -> str:
    """Returns text on one line: what cannot be seen or breaks the line is shown by its code."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def markdown(text: str) -> str:
    """Returns text that Markdown shows as it is, in a heading and in a table."""
    safe = html.escape(plain(text), quote=False)
    return MARKDOWN_MARKS.sub(r"\\\g<0>", safe)


def markup(text: str) -> str:
    """Returns text that HTML shows as it is."""
    return html.escape(plain(text))


def figure_text(text: str) -> str:
    """Returns text that matplotlib shows as it is: no mathtext, and no label that is left out."""
    safe = plain(text).replace("$", r"\$")
    return f" {safe}" if safe.startswith("_") else safe


def show(table: Table) -> None:
    """Prints a table, whose strings are text, as wide as the terminal or as a log."""
    width = None if sys.stdout.isatty() else LOG_WIDTH
    Console(width=width, markup=False, emoji=False, highlight=False).print(table)


def add_row(table: Table, *cells: str) -> None:
    """Adds a row of free text."""
    table.add_row(*map(plain, cells))
