"""The console script `hab-planner`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_tasks.io.console import Command, run_script

PLAN_HELP = """Prints the planning domain, a task's problem and its plan.

Example:
  hab-planner plan HabSetTable-v1

The plan is implied by the task's declaration; with --solve, Fast Downward computes one of minimal
length."""


@dataclass(frozen=True, kw_only=True)
class PlanCommand(Command):
    """Options of `hab-planner plan`."""

    help: ClassVar[str] = PLAN_HELP
    work: ClassVar[str] = "hab_plans.print_plan:run"

    env: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="ID")]
    """Environment id of a task, e.g. HabSetTable-v1."""
    solve: bool = False
    """Compute the plan with Fast Downward."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Also write the plan to this file."""
    force: bool = False
    """Overwrite FILE."""


COMMANDS: dict[str, type[Command]] = {"plan": PlanCommand}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-planner`; returns its exit status."""
    return run_script("hab-planner", COMMANDS, arguments)
