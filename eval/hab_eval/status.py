"""Tables of docs/status.md and README.md: who solves which environment, and what is run again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from hab_eval.leaderboard import (
    PRIVILEGED_MARK,
    Submissions,
    agent_label,
    group_title,
    scenes_of,
)
from hab_eval.plain_text import markdown
from hab_eval.results import RunRecord
from hab_tasks.registration import ENTRY_POINTS

REFERENCES = "hab_eval:"
"""Agents of this package act without looking; they are references, not results."""

LEARNED = ("hab_ppo:", "hab_tp_srl:")
NONE, AGAIN = "none", "to be run again"

PAPER = {"HabPick-v1": "86.3 (MonolithicRL, depth; Table 3)"}
"""Best success rate that the paper prints for unseen layouts [%]; the others are bars of Fig. 5."""

PAPER_MISSING = "not printed"

Link = Callable[[RunRecord], str]


def best_table(submissions: Submissions, leaderboard: str) -> str:
    """Returns the best agents of every environment, with a link to their commands.

    Without true state: the agent reads its observations only. Rows of other layouts of the same
    environment count alike.
    """
    lines = [
        ("environment", "without true state", "learned", "any agent", "paper"),
        ("---",) * 5,
    ]
    for env in _environments(submissions.all.values()):
        chosen = (
            _best(submissions, env, lambda record: not record.privileged),
            _best(submissions, env, lambda record: record.agent.startswith(LEARNED)),
            _best(submissions, env, lambda record: True),
        )
        cells = (_best_cell(one, leaderboard) for one in chosen)
        lines.append((env, *cells, PAPER.get(env, PAPER_MISSING)))
    return _text(lines)


def rows_table(submissions: Submissions, leaderboard: str) -> str:
    """Returns every current submission: agent, success, dataset, split and version."""
    lines = [
        ("environment", "agent", "success % (95 % interval)", "n", "dataset", "split", "version"),
        ("---",) * 7,
    ]
    environments = _environments(submissions.current.values())
    ranked = sorted(
        submissions.current.values(),
        key=lambda one: (environments.index(one.env), -one.summary.success.mean, one.seed),
    )
    for record in ranked:
        success = record.summary.success
        low, high = (100.0 * bound for bound in success.ci95)
        lines.append(
            (
                record.env,
                f"[{markdown(agent_label(record))}]({link(record, leaderboard)})",
                f"{100.0 * success.mean:.1f} [{low:.1f}, {high:.1f}]",
                str(success.n),
                markdown(scenes_of(record)),
                markdown(record.split),
                markdown(record.versions.get("hab-tasks", "?")),
            )
        )
    return _text(lines)


def again_table(submissions: Submissions, leaderboard: str) -> str:
    """Returns the submissions of older versions, a line per agent; `leaderboard` is not used."""
    del leaderboard
    by_agent: dict[str, list[tuple[str, RunRecord]]] = {}
    for name, date in submissions.again.items():
        record = submissions.all[name]
        by_agent.setdefault(record.agent.partition(":")[2], []).append((date, record))
    lines = [("agent", "rows", "environments", "datasets", "last run"), ("---",) * 5]
    for agent in sorted(by_agent):
        dates, records = zip(*by_agent[agent], strict=True)
        names = [env.removeprefix("Hab").removesuffix("-v1") for env in _environments(records)]
        environments = f"all {len(names)}" if len(names) == len(ENTRY_POINTS) else ", ".join(names)
        datasets = sorted({record.scene_dataset for record in records})
        cells = (agent, str(len(records)), environments, ", ".join(datasets), max(dates))
        lines.append(tuple(map(markdown, cells)))
    return _text(lines)


TABLES = {"best": best_table, "rows": rows_table, "again": again_table}
"""Name in a page's mark -> table."""


def link(record: RunRecord, leaderboard: str) -> str:
    """Returns the link to the table and the commands of a row's environment and dataset."""
    heading = group_title(record).lower().replace(" ", "-")
    return f"{leaderboard}#{''.join(c for c in heading if c.isalnum() or c in '-_')}"


def _best(
    submissions: Submissions, env: str, counts: Callable[[RunRecord], bool]
) -> RunRecord | str:
    """Returns the best current row, else why there is none."""
    own = {
        name: record
        for name, record in submissions.all.items()
        if record.env == env and not record.agent.startswith(REFERENCES) and counts(record)
    }
    current = [record for name, record in own.items() if name not in submissions.again]
    if current:
        return max(current, key=lambda one: (one.summary.success.mean, one.summary.success.n))
    return AGAIN if own else NONE


def _best_cell(best: RunRecord | str, leaderboard: str) -> str:
    if isinstance(best, str):
        return best
    name = markdown(best.agent.partition(":")[2])
    mark = f" {PRIVILEGED_MARK}" if best.privileged else ""
    success = best.summary.success
    percent = f"{100.0 * success.mean:.1f} of {success.n}"
    return f"[{name}{mark}]({link(best, leaderboard)}): {percent}"


def _environments(records: Iterable[RunRecord]) -> list[str]:
    """Returns the environments of some rows; the registered ones first, in their order."""
    order = {env: number for number, env in enumerate(ENTRY_POINTS)}
    return sorted({one.env for one in records}, key=lambda env: (order.get(env, len(order)), env))


def _text(lines: Sequence[Sequence[str]]) -> str:
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
