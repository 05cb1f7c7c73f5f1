"""Report of a study: table with intervals and paired tests, figure, README."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from hab_eval.records.paired import compare
from hab_eval.records.results import RunRecord
from hab_eval.records.stats import Estimate, exact_mcnemar, wilson_interval
from matplotlib.axes import Axes

from hab_ppo.commands import StudyCommand
from hab_ppo.studies.study import FULL, Arm, Condition, Study
from hab_tasks.figure_style import BLUE, GREEN, ORANGE, VERMILION, bare, new_figure, save
from hab_tasks.io.files import written_aside

WIDTH_IN = 6.0
COLORS = (BLUE, ORANGE, GREEN, VERMILION, "#CC79A7", "#56B4E9", "#000000")
MARKERS = "osD^vPX"
LIKELY = 0.05


@dataclass(frozen=True, kw_only=True)
class Result:
    """An evaluation of a study with its result.

    Attributes:
        row: Row of the table; its seeds have the same.
        arm: The arm; None for a reference.
        condition: How it was evaluated.
        measure: ``success``, or the stage of a task that counts as success.
        record: The result.
        entries: Metrics of the training (`hab_ppo.progress`).
    """

    row: str
    arm: Arm | None
    condition: Condition
    measure: str
    record: RunRecord
    entries: Sequence[dict[str, Any]]

    def estimate(self, measure: str) -> Estimate:
        """Returns the estimate of a measure: success, a score, or a stage."""
        summary = self.record.summary
        if measure == "success":
            return summary.success
        return {**summary.stages, **summary.scores}[measure]


def write_report(study: Study, options: StudyCommand, results: Sequence[Result]) -> str:
    """Writes figure and README into the study's folder; returns the table."""
    table = "\n".join(_table(results))
    _draw(study, results, options.out / f"{study.name}.png")
    write_readme(
        options.out,
        f"# {study.title}",
        f"{study.question} `{options.command()}`",
        f"{study.protocol} {_budgets(study, options.scale)} Evaluation: test layouts, seed "
        f"{results[0].record.seed}.",
        table,
        f"![{study.title}]({study.name}.png)",
        f"Result: {_outcome(results)}",
        *([f"Reading: {study.reading}"] if study.reading and options.scale == FULL else []),
        f"Differs from the paper: {study.differs}",
    )
    return table


def write_readme(out: Path, *parts: str) -> None:
    """Writes the README of a study."""
    with written_aside(out / "README.md") as scratch:
        scratch.write_text("\n\n".join(parts) + "\n", encoding="utf-8")


def _budgets(study: Study, scale: str) -> str:
    """Returns the budgets in words."""
    arms: dict[str, list[str]] = {}
    for arm in study.arms:
        one = arm.budgets[scale]
        parts = [f"{one.steps:,} steps of PPO"] * bool(one.steps)
        if arm.recipe.distill is not None and one.labelled[0]:
            rounds, steps = one.labelled
            parts.insert(0, f"{rounds * steps:,} labelled steps")
        seeds = f"{one.seeds} seed" + "s" * (one.seeds > 1)
        arms.setdefault(f"{', '.join(parts)}; {seeds}", []).append(arm.name)
    if len(arms) == 1:
        return f"Budget ({scale}): {next(iter(arms))}."
    parts = [
        f"{' to '.join(dict.fromkeys((names[0], names[-1])))}: {budget}"
        for budget, names in arms.items()
    ]
    return f"Budgets ({scale}): {'. '.join(parts)}."


# Table ---------------------------------------------------------------------------------------


def _rows(results: Iterable[Result]) -> dict[str, list[Result]]:
    rows: dict[str, list[Result]] = {}
    for one in results:
        rows.setdefault(one.row, []).append(one)
    return rows


def _table(results: Sequence[Result]) -> list[str]:
    """Returns the lines of the table."""
    scores = sorted({name for one in results for name in one.record.summary.scores})
    rows = _rows(results)
    first = next(iter(rows.values()))
    several = any(len(row) > 1 for row in rows.values())
    head = ["policy", "solved", "success % [95 %]", *["seeds %"] * several]
    head += [f"{name.upper()} %" for name in scores] + ["failures", "against the first row"]
    lines = [head, ["---"] * len(head)]
    for name, row in rows.items():
        successes, count = _solved(row)
        low, high = wilson_interval(successes, count)
        rates = [100 * one.estimate(one.measure).mean for one in row]
        line = [name, f"{successes} of {count}"]
        line += [f"{100 * successes / count:.1f} [{100 * low:.1f}, {100 * high:.1f}]"]
        line += [", ".join(f"{rate:.1f}" for rate in rates)] * several
        line += [_score(row, score) for score in scores]
        line += [_failures(row), _against(first, row)]
        lines.append(line)
    return [f"| {' | '.join(line)} |" for line in lines]


def _solved(row: Sequence[Result]) -> tuple[int, int]:
    """Returns the number of solved episodes of all seeds, and of all episodes."""
    estimates = [one.estimate(one.measure) for one in row]
    return sum(round(one.mean * one.n) for one in estimates), sum(one.n for one in estimates)


def _score(row: Sequence[Result], name: str) -> str:
    found = [one.record.summary.scores.get(name) for one in row]
    known = [one.mean for one in found if one is not None]
    return f"{100 * np.mean(known):.1f}" if known else ""


def _failures(row: Sequence[Result]) -> str:
    counts: dict[str, int] = {}
    for one in row:
        for name, count in one.record.summary.failures.items():
            counts[name] = counts.get(name, 0) + count
    ordered = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    return ", ".join(f"{name} {count}" for name, count in ordered)


def _against(first: Sequence[Result], row: Sequence[Result]) -> str:
    """Returns the difference to the first row on the same episodes, and its p-value."""
    if row is first:
        return ""
    difference, p_value = _paired(first, row)
    return "" if p_value is None else f"{difference:+.1f}, p = {p_value:.2g}"


def _paired(first: Sequence[Result], row: Sequence[Result]) -> tuple[float, float | None]:
    """Returns a difference in percentage points, and p by McNemar's test with seeds pooled."""
    if any(one.measure != "success" or one.arm is None for one in (*first, *row)):
        return 0.0, None
    pairs = [compare(b.record, a.record) for a, b in zip(first, row, strict=False)]
    known = [pair for pair in pairs if pair is not None]
    if not known:
        return 0.0, None
    ours, theirs = (sum(getattr(p, f"only_{side}") for p in known) for side in ("first", "second"))
    difference = 100 * (ours - theirs) / sum(pair.n for pair in known)
    return difference, exact_mcnemar(ours, theirs)


def _outcome(results: Sequence[Result]) -> str:
    """Returns the best and the worst row, and how many differ from the first."""
    rows = {name: row for name, row in _rows(results).items() if row[0].arm is not None}
    rates = {name: _solved(row) for name, row in rows.items()}
    ordered = sorted(rates, key=lambda name: rates[name][0] / rates[name][1])
    told = [f"{name}, {rates[name][0]} of {rates[name][1]}" for name in ordered]
    first = next(iter(rows))
    tests = [_paired(rows[first], row)[1] for name, row in rows.items() if name != first]
    known = [p_value for p_value in tests if p_value is not None]
    ends = f"most: {told[-1]}; fewest: {told[0]}"
    if not known:
        return f"{ends}."
    likely = sum(p_value < LIKELY for p_value in known)
    differ = f"{likely} of {len(known)} rows differ from {first} at p < {LIKELY:g}"
    return f"{ends}; {differ} (McNemar, paired episodes)."


# Figure --------------------------------------------------------------------------------------


def _draw(study: Study, results: Sequence[Result], out: Path) -> None:
    kind, minutes = study.figure.kind, study.figure.minutes
    trained = [one for one in results if one.arm is not None]
    rows = len({one.arm.name for one in trained if one.arm is not None})
    height_in = 0.6 + 0.3 * rows if kind == "bars" else 3.6
    figure = new_figure(WIDTH_IN, max(2.4, height_in))
    axes = figure.subplots(1, 1 + minutes, sharey=True, squeeze=False)[0]
    if kind == "curves":
        _curves(axes[0], study, trained, "steps")
        axes[0].set(xlabel="environment steps", ylabel="success")
        if minutes:
            _curves(axes[1], study, trained, "minutes")
            axes[1].set(xlabel="minutes")
        axes[0].legend(fontsize=7, frameon=False)
    elif kind == "lines":
        _lines(axes[0], study, trained)
    else:
        _bars(axes[0], study, _rows(trained))
    for axis in axes:
        bare(axis)
        axis.grid(alpha=0.3)
    save(figure, out)


def _curves(axis: Axes, study: Study, results: Sequence[Result], over: str) -> None:
    """Draws mean and standard deviation over the seeds of each arm."""
    arms: dict[str, list[Result]] = {}
    for one in results:
        if one.arm is not None and one.condition is one.arm.conditions[0]:
            arms.setdefault(one.arm.name, []).append(one)
    for number, (name, seeds) in enumerate(arms.items()):
        color = COLORS[number % len(COLORS)]
        stage = "" if seeds[0].measure == "success" else "stage/"
        metric = f"{stage}{seeds[0].measure}"
        lines = [_line(one.entries, f"eval/{metric}", over) for one in seeds]
        x, mean, deviation = _averaged(lines)
        axis.plot(x, mean, marker=MARKERS[number % len(MARKERS)], ms=3, color=color, label=name)
        axis.fill_between(x, mean - deviation, mean + deviation, color=color, alpha=0.2, lw=0)
        if study.figure.training:
            lines = [_line(one.entries, f"train/{metric}", over) for one in seeds]
            x, mean, _ = _averaged(lines)
            axis.plot(x, mean, color=color, alpha=0.5, lw=0.8, ls="--")
    axis.set_ylim(0, 1)


def _line(entries: Sequence[dict[str, Any]], metric: str, over: str) -> np.ndarray:
    """Returns the points (2, K) of a metric."""
    scale = {"steps": ("steps", 1.0), "minutes": ("seconds", 1 / 60)}[over]
    points = [(scale[1] * one[scale[0]], one[metric]) for one in entries if metric in one]
    return np.array(points, dtype=float).reshape(-1, 2).T


def _averaged(lines: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns x, mean and standard deviation of lines at the x of the first."""
    lines = [line for line in lines if line.size]
    if not lines:
        return np.empty(0), np.empty(0), np.empty(0)
    x = lines[0][0]
    values = np.stack([np.interp(x, *line) for line in lines])
    return x, values.mean(axis=0), values.std(axis=0)


def _lines(axis: Axes, study: Study, results: Sequence[Result]) -> None:
    """Draws the measure over the conditions: mean and deviation of seeds, or interval of one."""
    lines: dict[str, dict[float, list[Estimate]]] = {}
    for one in results:
        at = lines.setdefault(one.condition.line, {})
        at.setdefault(one.condition.x, []).append(one.estimate(study.figure.measure))
    for number, (name, points) in enumerate(lines.items()):
        x = np.array(sorted(points))
        values = [[one.mean for one in points[at]] for at in x]
        mean = np.array([np.mean(one) for one in values])
        if max(map(len, values)) > 1:
            spread = np.tile([np.std(one) for one in values], (2, 1))
        else:
            ends = np.array([points[at][0].ci95 for at in x]).T
            spread = np.abs(ends - mean)
        style = {"marker": MARKERS[number], "color": COLORS[number], "label": name}
        axis.errorbar(x, mean, spread, capsize=3, **style)  # pyright: ignore[reportArgumentType]
    axis.set(xlabel=study.figure.label, ylabel=_label(study), ylim=(0, 1))
    axis.set_xticks(sorted({one.condition.x for one in results}))
    axis.legend(fontsize=8, frameon=False)


def _bars(axis: Axes, study: Study, rows: dict[str, list[Result]]) -> None:
    """Draws success with its interval for each row of the table."""
    solved = [_solved(row) for row in rows.values()]
    rates = np.array([successes / count for successes, count in solved])
    ends = np.array([wilson_interval(*one) for one in solved]).T
    places = np.arange(len(rows))[::-1]
    axis.barh(places, rates, xerr=np.abs(ends - rates), color=BLUE, alpha=0.8, capsize=3)
    axis.set_yticks(places, list(rows), fontsize=8)
    axis.set(xlabel=_label(study), xlim=(0, 1))


def _label(study: Study) -> str:
    measure = study.figure.measure
    return measure if measure == "success" else measure.upper()
