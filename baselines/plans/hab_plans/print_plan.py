"""`hab-planner plan`: prints a domain, a problem and a plan."""

from __future__ import annotations

from hab_plans.cli import PlanCommand
from hab_plans.plan import plan_of
from hab_plans.problem import domain, problem_of
from hab_plans.solve import solve
from hab_tasks.io.console import tell
from hab_tasks.io.files import check_file, written_aside


def run(options: PlanCommand) -> int:
    """Prints domain, problem and plan, and writes the plan if requested."""
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
