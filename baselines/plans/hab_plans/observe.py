"""Reads a task's predicates from the simulator, by the functions that define its success."""

from __future__ import annotations

from hab_plans.problem import ROOM, Atom, atoms_of, problem_of
from hab_tasks.tasks.base import Condition
from hab_tasks.tasks.task_env import TaskEnv


def observed(env: TaskEnv, row: int = 0) -> frozenset[Atom]:
    """Returns the current atoms: held, placed, open and closed.

    A partly open door is neither open nor closed.

    Args:
        env: A task's environment, unwrapped.
        row: Batch row.
    """
    objects, articulations = range(env.task.objects), range(len(env.task.articulations))
    conditions = (
        *(Condition(held=(k,)) for k in objects),
        *(Condition(placed=(k,)) for k in objects),
        *(Condition(opened=(j,)) for j in articulations),
        *(Condition(closed=(j,)) for j in articulations),
    )
    true = [atoms_of(env.task.spec, c) for c in conditions if bool(env.holds(c)[row])]
    return frozenset().union(*true)


def start_from(env: TaskEnv, row: int = 0) -> frozenset[Atom]:
    """Returns the initial state for replanning: observed and static atoms.

    Args:
        env: A task's environment, unwrapped.
        row: Batch row.
    """
    return start_given(env.default_id(), observed(env, row))


def start_given(env_id: str, seen: frozenset[Atom]) -> frozenset[Atom]:
    """Returns a task's initial state in which these atoms hold: held, placed, open and closed.

    The robot is at no pose, so that the plan starts with navigation.

    Raises:
        PlannerError: Not the id of a task.
    """
    problem = problem_of(env_id)
    changing = {"at", "placed", "holding", "hand-empty", "is-open", "is-closed"}
    # The room is a container that is always open; doors and drawers are as seen.
    kept = {a for a in problem.start if a[0] not in changing or a == ("is-open", ROOM)}
    # Conditions say only where an object is (`at`); the domain's `placed` follows.
    placed = {("placed", atom[1]) for atom in seen if atom[0] == "at"}
    empty = set() if any(atom[0] == "holding" for atom in seen) else {("hand-empty",)}
    return frozenset(kept | seen | placed | empty)
