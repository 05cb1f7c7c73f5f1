"""The console script `hab-planner`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_plans.plan import plan_of
from hab_plans.problem import domain, problem_of
from hab_tasks.io.console import Command, run_script, tell
from hab_tasks.io.files import check_file, written_aside

PLAN_HELP = """Prints the planning domain, a task's problem and its plan.

Example:
  hab-planner plan HabSetTable-v1

The plan is implied by the task's declaration; with --solve, Fast Downward computes one of minimal
length."""


@dataclass(frozen=True, kw_only=True)
class PlanCommand(Command):
    """Options of `hab-planner plan`."""

    help: ClassVar[str] = PLAN_HELP
    work: ClassVar[str] = "hab_plans.cli:run"

    env: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="ID")]
    """Environment id of a task, e.g. HabSetTable-v1."""
    solve: bool = False
    """Compute the plan with Fast Downward."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Also write the plan to this file."""
    force: bool = False
    """Overwrite FILE."""


COMMANDS: dict[str, type[Command]] = {"plan": PlanCommand}


def run(options: PlanCommand) -> int:
    """Prints domain, problem and plan, and writes the plan if requested."""
    from hab_plans.solve import solve  # takes a second; --help does without

    problem = problem_of(options.env)
    if options.out is not None:
        check_file(options.out, force=options.force)
    plan = solve(problem) if options.solve else plan_of(options.env)
    tell(domain())
    tell(problem.pddl())
    for number, action in enumerate(plan.actions, 1):
        tell(f"{number:2d}. {action!s:60s} {action.skill}")
    if options.out is not None:
        with written_aside(options.out) as scratch:
            scratch.write_text(plan.to_json(), encoding="utf-8")
        tell(f"wrote {len(plan.actions)} actions to {options.out}")
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-planner`; returns its exit status."""
    return run_script("hab-planner", COMMANDS, arguments)
