"""Scene datasets of the submissions: descriptions, figures and runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tomllib

from hab_eval.records.leaderboard import WILD, vary_command
from hab_eval.site.entries import Entry, dataset_rank, unique_slugs


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A figure of a dataset: file in the checkout's docs folder, caption and alternative text."""

    file: str
    caption: str
    alt: str

    @property
    def picture(self) -> str:
        """File name in the site."""
        return f"{Path(self.file).stem}.webp"


_DATA = tomllib.loads(Path(__file__).with_name("datasets.toml").read_text(encoding="utf-8"))
FIGURES = {name: tuple(Figure(**one) for one in them) for name, them in _DATA["figures"].items()}
DESCRIPTIONS: dict[str, str] = _DATA["descriptions"]


@dataclass(frozen=True, kw_only=True)
class DatasetPage:
    """A scene dataset.

    Attributes:
        name: Its name in the records.
        slug: The name as a file name.
        description: A paragraph.
        command: The command that generates the dataset; "" if it is not generated.
        figures: Figures that exist in the checkout.
        entries: Its submissions.
        layouts: (layout, number of episodes in all submissions), by name.
    """

    name: str
    slug: str
    description: str
    command: str
    figures: tuple[Figure, ...]
    entries: tuple[Entry, ...]
    layouts: tuple[tuple[str, int], ...]


def dataset_pages(entries: Sequence[Entry], docs: Path) -> list[DatasetPage]:
    """Returns a page for every scene dataset of the submissions."""
    names = sorted({entry.record.scene_dataset for entry in entries}, key=dataset_rank)
    pages = []
    for name, slug in zip(names, unique_slugs(names), strict=True):
        own = tuple(entry for entry in entries if entry.record.scene_dataset == name)
        wild = WILD.fullmatch(name)
        figures = FIGURES.get(f"{wild['base']}_wild" if wild else name, ())
        pages.append(
            DatasetPage(
                name=name,
                slug=slug,
                description=_described(name),
                command=vary_command(name),
                figures=tuple(one for one in figures if (docs / one.file).is_file()),
                entries=own,
                layouts=_layouts(own),
            )
        )
    return pages


def _described(name: str) -> str:
    wild = WILD.fullmatch(name)
    if wild is None:
        return DESCRIPTIONS.get(name, "A dataset of a submission.")
    return (
        f"Wild layouts, a stress test: layouts of {wild['base']} with furniture and kitchen at "
        "random positions, doors that a wall stops early, and aisles as narrow as the base. "
        "Consecutive episodes use different layouts."
    )


def _layouts(entries: Sequence[Entry]) -> tuple[tuple[str, int], ...]:
    counts = Counter(one.scene for entry in entries for one in entry.record.episodes)
    return tuple(sorted(counts.items()))
