"""Results of the Habitat 2.0 paper, from `paper.toml`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tomllib

ENV = "HabPick-v1"
PROTOCOLS = {
    "unseen": ("apartment", None, ("val", "test")),
    "seen": ("replicaCAD", "ycb", ("train",)),
}
"""Layouts of the paper -> scene dataset, objects and splits of comparable submissions."""


@dataclass(frozen=True, kw_only=True)
class PaperResult:
    """A success rate of the paper.

    Attributes:
        method: Name in the paper.
        layouts: ``seen`` or ``unseen`` layouts.
        percent: Success rate on Pick, as printed [%].
        source: Table or section.
        agent: Agent of this project that implements the method.
        note: Differences between the two protocols.
    """

    method: str
    layouts: str
    percent: str
    source: str
    agent: str
    note: str


@dataclass(frozen=True, kw_only=True)
class NotComparable:
    """A result of the paper without a counterpart, and the reason."""

    what: str
    reason: str


_DATA = tomllib.loads(Path(__file__).with_name("paper.toml").read_text(encoding="utf-8"))
RESULTS = tuple(PaperResult(**fields) for fields in _DATA["results"])
NOT_COMPARABLE = tuple(NotComparable(**fields) for fields in _DATA["not_comparable"])
