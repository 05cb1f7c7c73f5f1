"""Tables within Markdown pages, generated from the submissions and the benchmark reports.

The text between ``<!-- status: NAME -->`` and ``<!-- end of status -->`` is replaced by a table of
`hab_eval.records.status`. The text between ``<!-- bench: NAME UNIT -->`` and ``<!-- end of bench
-->`` is replaced by the rows of ``eval/benchmarks/NAME.json`` in this unit, or by all rows if no
unit is given.
"""

from __future__ import annotations

import re
from pathlib import Path

from hab_eval.bench.report import read_report, report_table
from hab_eval.errors import ResultError
from hab_eval.records.leaderboard import Submissions
from hab_eval.records.status import TABLES

BEGIN = re.compile(r"<!-- (?P<kind>status|bench): (?P<what>[^>]+?) -->\n")


def filled(page: str, submissions: Submissions, benchmarks: Path, leaderboard: str) -> str:
    """Regenerates the tables of a page.

    Args:
        page: Text of the page.
        submissions: All submissions.
        benchmarks: Folder of the benchmark reports.
        leaderboard: Link from the page to LEADERBOARD.md.

    Raises:
        ResultError: A table has no end mark, its name is unknown, or its report cannot be read.
    """
    parts, at = [], 0
    for begin in BEGIN.finditer(page):
        kind, what = begin["kind"], begin["what"]
        mark = f"<!-- end of {kind} -->"
        end = page.find(mark, begin.end())
        if end < 0:
            raise ResultError(f"The {kind} table {what} has no end mark {mark!r}.")
        if kind == "bench":
            name, _, unit = what.partition(" ")
            text = report_table(read_report(benchmarks / f"{name}.json"), unit)
        elif what in TABLES:
            text = TABLES[what](submissions, leaderboard)
        else:
            raise ResultError(f"No status table {what!r}; tables: {', '.join(sorted(TABLES))}.")
        parts += [page[at : begin.end()], text]
        at = end
    return "".join([*parts, page[at:]])
