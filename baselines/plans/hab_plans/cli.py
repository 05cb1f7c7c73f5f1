"""The console script `hab-planner`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_plans.plan import Plan, plan_of
from hab_plans.problem import domain, problem_of
from hab_tasks.console import Command, run_script
from hab_tasks.files import check_file, written_aside

PLAN_HELP = """Prints the planning domain, a task's problem and its plan.

Example:
  hab-planner plan HabSetTable-v1

The plan is implied by the task's declaration; with --solve, Fast Downward computes one of minimal
length."""


@dataclass(frozen=True, kw_only=True)
class PlanCommand(Command):
    """Options of `hab-planner plan`."""

    help: ClassVar[str] = PLAN_HELP

    env: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="ID")]
    """Environment id of a task, e.g. HabSetTable-v1."""
    solve: bool = False
    """Compute the plan with Fast Downward."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Also write the plan to this file."""
    force: bool = False
    """Overwrite FILE."""

    def run(self) -> int:
        """Prints domain, problem and plan, and writes the plan if requested."""
        problem = problem_of(self.env)
        if self.out is not None:
            check_file(self.out, force=self.force)
        if self.solve:
            from hab_plans.solve import solve  # a slow import

            plan = solve(problem)
        else:
            plan = plan_of(self.env)
        print(domain())
        print(problem.pddl())
        for number, action in enumerate(plan.actions, 1):
            print(f"{number:2d}. {action!s:60s} {action.skill}")
        if self.out is not None:
            _write(plan, self.out)
            print(f"wrote {len(plan.actions)} actions to {self.out}")
        return 0


COMMANDS: dict[str, type[Command]] = {"plan": PlanCommand}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-planner`; returns its exit status."""
    return run_script("hab-planner", COMMANDS, arguments)


def _write(plan: Plan, file: Path) -> None:
    """Writes the plan atomically."""
    with written_aside(file) as scratch:
        scratch.write_text(plan.to_json(), encoding="utf-8")
