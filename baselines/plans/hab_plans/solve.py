"""Optimal planning by Fast Downward, and plan validation, through unified-planning."""

from __future__ import annotations

from typing import Any

from unified_planning.engines import PlanGenerationResultStatus
from unified_planning.environment import get_environment
from unified_planning.exceptions import UPUsageError, UPValueError
from unified_planning.io import PDDLReader
from unified_planning.model import MinimizeSequentialPlanLength
from unified_planning.shortcuts import OneshotPlanner, SequentialSimulator

from hab_plans.plan import Action, Plan
from hab_plans.problem import Atom, NoPlanError, PlannerError, TaskProblem, domain

PLANNER = "fast-downward-opt"

UNSOLVABLE = (
    PlanGenerationResultStatus.UNSOLVABLE_PROVEN,
    PlanGenerationResultStatus.UNSOLVABLE_INCOMPLETELY,
)


def solve(problem: TaskProblem) -> Plan:
    """Returns a plan of minimal length.

    Raises:
        NoPlanError: The goal is unreachable.
        PlannerError: The planner failed.
    """
    parsed = _parsed(problem)
    parsed.add_quality_metric(MinimizeSequentialPlanLength())
    get_environment().credits_stream = None  # no banner
    with OneshotPlanner(name=PLANNER) as engine:
        planner: Any = engine
        result = planner.solve(parsed)
    if result.status in UNSOLVABLE:
        wanted = ", ".join(" ".join(atom) for atom in sorted(problem.goal))
        raise NoPlanError(f"No plan of {problem.name} reaches its goal ({wanted}) from its start.")
    if result.status is not PlanGenerationResultStatus.SOLVED_OPTIMALLY:
        raise PlannerError(f"Fast Downward found no plan of {problem.name}: {result.status.name}.")
    steps = (
        Action(name=step.action.name, things=tuple(str(thing) for thing in step.actual_parameters))
        for step in result.plan.actions
    )
    return Plan(task=problem.name, actions=tuple(steps))


def replay(problem: TaskProblem, plan: Plan) -> tuple[frozenset[Atom], ...]:
    """Simulates a plan; returns the true atoms of `problem.goal` initially and after each action.

    Raises:
        PlannerError: An action does not exist, or its precondition does not hold.
    """
    parsed = _parsed(problem)
    simulator = SequentialSimulator(parsed)
    state = simulator.get_initial_state()
    reached = [_holding(parsed, state, problem)]
    for number, action in enumerate(plan.actions):
        try:
            things = [parsed.object(thing) for thing in action.things]
            state = simulator.apply(state, parsed.action(action.name), things)
        except (UPUsageError, UPValueError) as error:
            message = f"Action {number + 1}, {action}, does not exist: {error}."
            raise PlannerError(message) from error
        if state is None:
            raise PlannerError(f"Action {number + 1}, {action}: its precondition does not hold.")
        reached.append(_holding(parsed, state, problem))
    return tuple(reached)


def _parsed(problem: TaskProblem) -> Any:
    return PDDLReader().parse_problem_string(domain(), problem.pddl())


def _holding(parsed: Any, state: Any, problem: TaskProblem) -> frozenset[Atom]:
    def holds(atom: Atom) -> bool:
        fluent = parsed.fluent(atom[0])(*(parsed.object(thing) for thing in atom[1:]))
        return bool(state.get_value(fluent).constant_value())

    return frozenset(atom for atom in problem.goal if holds(atom))
