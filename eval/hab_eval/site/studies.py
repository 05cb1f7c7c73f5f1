"""Studies of a checkout: text, figures and runs that answer one question."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hab_eval.records.leaderboard import read_submissions
from hab_eval.site.entries import Entry, make_entries, unique_slugs
from hab_eval.site.markdown_files import MarkdownFile, read_markdown, title_of

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
