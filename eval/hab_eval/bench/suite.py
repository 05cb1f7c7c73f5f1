"""Suites of `hab-eval bench`; packages register theirs in the entry-point group `GROUP`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hab_eval.bench.rows import BenchRow

if TYPE_CHECKING:
    from hab_eval.bench.options import BenchOptions

GROUP = "hab_eval.bench_suites"
"""Entry-point group of suites, e.g. ``sim = "hab_eval.bench.sim:SUITE"``."""

WriteLine = Callable[[str], None]

PICK = "HabPick-v1"
TIDY_HOUSE = "HabTidyHouse-v1"
FIRST_SCENE, DENSE_SCENE = "v3_sc0_staging_00", "apt_0"


@dataclass(frozen=True, kw_only=True)
class Suite:
    """A benchmark suite.

    Attributes:
        name: Value of ``--suite``.
        run: (options, write_line) -> rows.
        steps: Default number of steps (or plans) per repeat.
        groups: Default scenes, in groups that are measured together.
        is_round: Whether the scenes of ``--scene`` form one group, of at least two.
        takes_envs: Whether the suite supports ``--env``.
    """

    name: str
    run: Callable[[BenchOptions, WriteLine], list[BenchRow]]
    steps: int
    groups: tuple[tuple[str, ...], ...] = ((FIRST_SCENE,),)
    is_round: bool = False
    takes_envs: bool = False
