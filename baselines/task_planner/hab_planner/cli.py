"""The console script `hab-planner`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from hab_planner.plan import Plan, saved_plan
from hab_planner.problem import DOMAIN, problem_of
from hab_tasks.errors import HabError
from hab_tasks.files import check_file, written_aside
from hab_tasks.options import one_line, parse_only_command

EXIT_BAD_INPUT = 2

PLAN_HELP = """Shows the planning domain, a task's problem, and its plan.

Example:
  hab-planner plan HabSetTable-v1

The plan is the saved one; with --solve it is made anew, of minimal length, by Fast Downward."""


@dataclass(frozen=True, kw_only=True)
class PlanCommand:
    """Options of `hab-planner plan`."""

    env: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="ID")]
    """Environment id of a task, e.g. HabSetTable-v1."""
    solve: bool = False
    """Plan anew instead of showing the saved plan."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Also write the plan to this file."""
    force: bool = False
    """Replace the file if it is there."""

    def run(self) -> int:
        """Prints, and writes the plan where asked."""
        problem = problem_of(self.env)
        if self.out is not None:
            check_file(self.out, force=self.force)
        if self.solve:
            from hab_planner.solve import solve  # takes a second, and only this needs it

            plan = solve(problem)
        else:
            plan = saved_plan(self.env)
        print(DOMAIN.read_text(encoding="utf-8"))
        print(problem.pddl())
        for number, action in enumerate(plan.actions, 1):
            print(f"{number:2d}. {action!s:60s} {action.skill}")
        if self.out is not None:
            _write(plan, self.out)
            print(f"wrote {len(plan.actions)} actions to {self.out}")
        return 0


COMMANDS = {"plan": PlanCommand}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-planner`; returns its exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        if not arguments or arguments[0].startswith("-"):  # --help, or nothing
            print(f"usage: hab-planner plan ID [--solve] [--out FILE]\n\n{PLAN_HELP}")
            return 0 if arguments else EXIT_BAD_INPUT
        command = parse_only_command("hab-planner", COMMANDS, arguments, PLAN_HELP)
        return command.run()
    except HabError as error:
        print(f"hab-planner: {one_line(error)}", file=sys.stderr)
        return EXIT_BAD_INPUT


def _write(plan: Plan, file: Path) -> None:
    """Writes whole or not at all."""
    with written_aside(file) as scratch:
        scratch.write_text(plan.to_json(), encoding="utf-8")
