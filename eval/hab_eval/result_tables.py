"""Tables within Markdown pages, generated from the submissions and the benchmark reports.

The text between ``<!-- results: module:factory -->`` and ``<!-- end of results -->`` is replaced by
a table with one row per environment and one column per set of scenes and objects. The text between
``<!-- bench: NAME UNIT -->`` and ``<!-- end of bench -->`` is replaced by the rows of
``eval/benchmarks/NAME.json`` in this unit, or by all rows if no unit is given.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from hab_eval.bench.report import read_report, report_table
from hab_eval.errors import ResultError
from hab_eval.leaderboard import FEW_EPISODES, FEW_MARK, PRIVILEGED_MARK
from hab_eval.plain_text import markdown
from hab_eval.results import RunRecord
from hab_tasks.registration import ENTRY_POINTS

BEGIN = re.compile(r"<!-- (?P<kind>results|bench): (?P<what>[^>]+?) -->\n")


def filled(page: str, records: Iterable[RunRecord], benchmarks: Path) -> str:
    """Regenerates the tables of a page.

    Args:
        page: Text of the page.
        records: All submissions.
        benchmarks: Folder of the benchmark reports.

    Raises:
        ResultError: A table has no end mark, its agent has no submissions, or its report cannot be
            read.
    """
    by_agent: dict[str, list[RunRecord]] = {}
    for record in records:
        by_agent.setdefault(record.agent, []).append(record)
    parts, at = [], 0
    for begin in BEGIN.finditer(page):
        kind, what = begin["kind"], begin["what"]
        mark = f"<!-- end of {kind} -->"
        end = page.find(mark, begin.end())
        if end < 0:
            raise ResultError(f"The {kind} of {what} have no end mark {mark!r}.")
        if kind == "bench":
            name, _, unit = what.partition(" ")
            text = report_table(read_report(benchmarks / f"{name}.json"), unit)
        elif what in by_agent:
            text = table(by_agent[what])
        else:
            known = ", ".join(sorted(by_agent))
            raise ResultError(f"No submission of {what}; agents with submissions: {known}.")
        parts += [page[at : begin.end()], text]
        at = end
    return "".join([*parts, page[at:]])


def table(records: list[RunRecord]) -> str:
    """Returns the success rates of one agent [%]; small numbers of episodes are marked."""
    cells: dict[tuple[str, str], str] = {}
    for record in sorted(records, key=lambda record: record.seed):
        cells[record.env, scenes_of(record)] = _cell(record)
    columns = sorted({scenes for _, scenes in cells}, key=lambda name: ("wild" in name, name))
    order = {env_id: number for number, env_id in enumerate(ENTRY_POINTS)}
    rows = sorted({env for env, _ in cells}, key=lambda env: (order.get(env, len(order)), env))
    mark = f" {PRIVILEGED_MARK}" if records[0].privileged else ""
    lines = [[f"{records[0].agent_name}{mark}", *columns], ["---"] * (1 + len(columns))]
    lines += [[f"{env}", *(cells.get((env, name), "") for name in columns)] for env in rows]
    return "\n".join(f"| {' | '.join(map(markdown, line))} |" for line in lines) + "\n"


def scenes_of(record: RunRecord) -> str:
    """Returns the scenes and objects of a run, e.g. ``replicaCAD, ycb``."""
    return ", ".join(name for name in (record.scene_dataset, record.objects) if name)


def _cell(record: RunRecord) -> str:
    success = record.summary.success
    few = f" of {success.n}{FEW_MARK}" if success.n < FEW_EPISODES else ""
    return f"{100.0 * success.mean:.1f}{few}"
