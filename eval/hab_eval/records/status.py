"""Tables of docs/status.md and README.md: who solves which environment."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from hab_eval.records import paper
from hab_eval.records.leaderboard import (
    PRIVILEGED_MARK,
    factory_name,
    group_title,
    scenes_of,
    short_label,
)
from hab_eval.records.plain_text import markdown
from hab_eval.records.results import RunRecord
from hab_tasks.registration import ENTRY_POINTS

REFERENCES = "hab_eval:"
"""Agents of this package act without looking; they are references, not results."""

REMOTE = "hab_eval:remote"
"""The exception: a policy in another process."""

LEARNED = ("hab_ppo:", "hab_tp_srl:")
NONE = "none"

PAPER_MISSING = "not printed"
"""The paper prints rates of Pick; those of the other skills and of tasks are bars of figures."""

HANDLE_MARK = "‡"
FIRST_DATASET = "apartment"

BEST_COLUMNS: dict[str, Callable[[RunRecord], bool]] = {
    "without true state": lambda record: not record.privileged,
    "learned": lambda record: record.agent.startswith(LEARNED),
    "any agent": lambda record: True,
}
"""Title of a column -> whether a row counts there."""


def best_table(submissions: Mapping[str, RunRecord], leaderboard: str) -> str:
    """Returns the best agents of every environment, with a link to their commands.

    Without true state: the agent reads its observations only. Rows of the apartment come before
    those of other datasets.
    """
    lines = [
        ("environment", *BEST_COLUMNS, "paper"),
        ("---",) * 5,
    ]
    for env, chosen in best_rows(submissions):
        cells = (_best_cell(one, leaderboard) for one in chosen)
        lines.append((env, *cells, _paper_cell(env)))
    return _text(lines)


def best_rows(submissions: Mapping[str, RunRecord]) -> list[tuple[str, list[RunRecord | str]]]:
    """Returns every environment with its best row of `BEST_COLUMNS`, or why there is none."""
    return [
        (env, [_best(submissions, env, counts) for counts in BEST_COLUMNS.values()])
        for env in _environments(submissions.values())
    ]


def rows_table(submissions: Mapping[str, RunRecord], leaderboard: str) -> str:
    """Returns every submission: agent, success, dataset, split and version."""
    lines = [
        ("environment", "agent", "success % (95 % interval)", "n", "dataset", "split", "version"),
        ("---",) * 7,
    ]
    environments = _environments(submissions.values())
    ranked = sorted(
        submissions.values(),
        key=lambda one: (environments.index(one.env), -one.summary.success.mean, one.seed),
    )
    for record in ranked:
        success = record.summary.success
        low, high = (100.0 * bound for bound in success.ci95)
        changes = (f"{name}={value}" for name, value in record.env_options.items())
        lines.append(
            (
                record.env,
                f"[{markdown(short_label(record))}]({link(record, leaderboard)})",
                f"{100.0 * success.mean:.1f} [{low:.1f}, {high:.1f}]",
                str(success.n),
                markdown("; ".join((scenes_of(record), *changes))),
                markdown(record.split),
                markdown(record.versions.get("hab-tasks", "?")),
            )
        )
    return _text(lines)


TABLES = {"best": best_table, "rows": rows_table}
"""Name in a page's mark -> table."""


def link(record: RunRecord, leaderboard: str) -> str:
    """Returns the link to the table and the commands of a row's environment and dataset."""
    heading = group_title(record).lower().replace(" ", "-")
    return f"{leaderboard}#{''.join(c for c in heading if c.isalnum() or c in '-_')}"


def _best(
    submissions: Mapping[str, RunRecord], env: str, counts: Callable[[RunRecord], bool]
) -> RunRecord | str:
    """Returns the best row, else that there is none."""
    own = [
        record
        for record in submissions.values()
        if record.env == env and _competes(record) and counts(record)
    ]
    return max(own, key=_goodness, default=NONE)


def _competes(record: RunRecord) -> bool:
    """Whether a row is a result on the paper's track, and no reference."""
    reference = record.agent.startswith(REFERENCES) and record.agent != REMOTE
    return record.targets == "positions" and not record.env_options and not reference


def _goodness(record: RunRecord) -> tuple[bool, float, int]:
    success = record.summary.success
    return record.scene_dataset == FIRST_DATASET, success.mean, success.n


def _paper_cell(env: str) -> str:
    """Returns the best rate that the paper prints for unseen layouts."""
    if env != paper.ENV:
        return PAPER_MISSING
    unseen = [one for one in paper.RESULTS if one.layouts == "unseen"]
    best = max(unseen, key=lambda one: float(one.percent))
    return f"{best.percent} % ({best.method}; {best.source})"


def _best_cell(best: RunRecord | str, leaderboard: str) -> str:
    if isinstance(best, str):
        return best
    name = markdown(factory_name(best))
    marks = PRIVILEGED_MARK * best.privileged + HANDLE_MARK * best.handle_position
    mark = f" {marks}" if marks else ""
    success = best.summary.success
    percent = f"{100.0 * success.mean:.1f} % (n = {success.n})"
    return f"[{name}{mark}]({link(best, leaderboard)}): {percent}"


def _environments(records: Iterable[RunRecord]) -> list[str]:
    """Returns the environments of some rows; the registered ones first, in their order."""
    order = {env: number for number, env in enumerate(ENTRY_POINTS)}
    return sorted({one.env for one in records}, key=lambda env: (order.get(env, len(order)), env))


def _text(lines: Sequence[Sequence[str]]) -> str:
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
