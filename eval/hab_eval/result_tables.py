"""Tables within Markdown pages, generated from the submissions and the benchmark reports.

The text between ``<!-- results: module:factory -->`` and ``<!-- end of results -->`` is replaced by
a table with one row per environment and one column per set of scenes and objects, and for a pattern
such as ``module:*`` with one row per matching agent and environment. The text between
``<!-- bench: NAME UNIT -->`` and ``<!-- end of bench -->`` is replaced by the rows of
``eval/benchmarks/NAME.json`` in this unit, or by all rows if no unit is given.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from fnmatch import fnmatchcase
from pathlib import Path

from hab_eval.bench.report import read_report, report_table
from hab_eval.errors import ResultError
from hab_eval.leaderboard import FEW_EPISODES, FEW_MARK, PRIVILEGED_MARK
from hab_eval.plain_text import markdown
from hab_eval.results import RunRecord
from hab_tasks.registration import ENTRY_POINTS

Cells = dict[tuple[tuple[str, ...], str], str]
"""(Key of a row, scenes) -> success rate."""

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
        elif own := _matching(by_agent, what):
            text = module_table(own)
        else:
            known = ", ".join(sorted(by_agent))
            raise ResultError(f"No submission of {what}; agents with submissions: {known}.")
        parts += [page[at : begin.end()], text]
        at = end
    return "".join([*parts, page[at:]])


def table(records: list[RunRecord]) -> str:
    """Returns the success rates of one agent [%]; small numbers of episodes are marked."""
    cells: Cells = {}
    for record in sorted(records, key=lambda record: record.seed):
        cells[(record.env,), scenes_of(record)] = _cell(record)
    mark = f" {PRIVILEGED_MARK}" if records[0].privileged else ""
    return _text((f"{records[0].agent_name}{mark}",), cells)


def module_table(records: list[RunRecord]) -> str:
    """Returns the success rates of several agents [%], each with default options."""
    cells: Cells = {}
    for record in sorted(records, key=lambda record: record.seed):
        if not record.options:
            agent = record.agent.partition(":")[2]
            cells[(record.env, agent), scenes_of(record)] = _cell(record)
    return _text(("environment", "agent"), cells)


def _matching(by_agent: Mapping[str, list[RunRecord]], pattern: str) -> list[RunRecord]:
    """Returns the submissions of all agents that match a pattern such as ``module:*``."""
    own = (by_agent[agent] for agent in by_agent if fnmatchcase(agent, pattern))
    return [record for records in own for record in records]


def _text(head: tuple[str, ...], cells: Cells) -> str:
    """Returns a table; `head` names the columns that the rows' keys, environment first, fill."""
    columns = sorted({scenes for _, scenes in cells}, key=lambda name: ("wild" in name, name))
    order = {env_id: number for number, env_id in enumerate(ENTRY_POINTS)}
    rows = sorted({row for row, _ in cells}, key=lambda row: (order.get(row[0], len(order)), row))
    lines = [[*head, *columns], ["---"] * (len(head) + len(columns))]
    lines += [[*row, *(cells.get((row, name), "") for name in columns)] for row in rows]
    return "\n".join(f"| {' | '.join(map(markdown, line))} |" for line in lines) + "\n"


def scenes_of(record: RunRecord) -> str:
    """Returns the scenes and objects of a run, e.g. ``replicaCAD, ycb``."""
    return ", ".join(name for name in (record.scene_dataset, record.objects) if name)


def _cell(record: RunRecord) -> str:
    success = record.summary.success
    few = f" of {success.n}{FEW_MARK}" if success.n < FEW_EPISODES else ""
    return f"{100.0 * success.mean:.1f}{few}"
