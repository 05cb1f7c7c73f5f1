"""The work of `hab-eval sweep`."""

from __future__ import annotations

from dataclasses import replace

from hab_eval.commands.options import SweepCommand
from hab_eval.commands.run import evaluated
from hab_eval.records.config import EvalConfig
from hab_eval.records.leaderboard import agent_label, group_title
from hab_eval.records.plain_text import plain, show
from hab_eval.records.results import RunRecord
from hab_eval.records.sweep import BASE, Level, change_of, draw_sweep, levels_of, sweep_table
from hab_eval.run.environments import request_of
from hab_tasks import load_episodes
from hab_tasks.errors import OptionError
from hab_tasks.option_values import LARGEST_SEED


def sweep(options: SweepCommand) -> int:
    """Evaluates the agent at each level of each axis; prints and plots the changes."""
    levels = levels_of([axis for axis in options.axes.split(",") if axis])
    if options.layouts is None and any(level.other_layouts for level in levels):
        raise OptionError(
            "The axis layout needs --layouts PATH, a dataset of other layouts; `hab-tasks vary "
            "apartment --wild --out PATH` generates one."
        )
    config = options.config_of_run()
    configs = [_changed(config, level, options.layouts) for level in levels]
    for level, one in zip(levels, configs, strict=True):
        _check(level, one)
    records = [_record(options, level, one) for level, one in zip(levels, configs, strict=True)]
    base, rest = records[0], zip(levels[1:], records[1:], strict=True)
    changes = [change_of(level, base, record) for level, record in rest]
    success = f"{100.0 * base.summary.success.mean:.1f} % of {base.summary.success.n}"
    title = f"{agent_label(base)} on {group_title(base)}: {success}"
    show(sweep_table(plain(title), changes))
    figure = options.out / "sweep.png"
    draw_sweep(title, changes, figure)
    print(f"wrote {figure}")
    return 0


def _check(level: Level, config: EvalConfig) -> None:
    """Raises OptionError, before the first run, if an environment lacks what an axis changes."""
    try:
        load_episodes(request_of(config), 1)
    except OptionError as error:
        if level is BASE:
            raise
        raise OptionError(f"{error} Leave {level.axis} out of --axes.") from error


def _changed(config: EvalConfig, level: Level, layouts: str | None) -> EvalConfig:
    """Returns the configuration of a level."""
    env_options = {**config.env_options, **level.env_options}
    changed = replace(config, env_options=dict(sorted(env_options.items())))
    if level.other_seed:
        changed = replace(changed, seed=(config.seed + 1) % LARGEST_SEED)
    if level.other_layouts and layouts is not None:
        changed = replace(changed, scene_dataset=layouts, split=None)
    return changed


def _record(options: SweepCommand, level: Level, config: EvalConfig) -> RunRecord:
    """Returns the run of a level, which an interrupted sweep may have."""
    out = options.out / ("none" if level is BASE else level.folder)
    print(f"{out}: {level.axis} {level.name}".rstrip(), flush=True)
    resume = options.resume and out.exists()
    return evaluated(replace(options, out=out, resume=resume), config)
