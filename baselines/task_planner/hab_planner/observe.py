"""What of a task's predicates holds in the simulator, by the functions that its success uses."""

from __future__ import annotations

from hab_planner.problem import ROOM, Atom, atoms_of, problem_of
from hab_tasks.tasks.base import Condition
from hab_tasks.tasks.task_env import TaskEnv


def observed(env: TaskEnv, row: int = 0) -> frozenset[Atom]:
    """Returns what is held, where it belongs, open and closed at this moment.

    A door between open and closed is neither.

    Args:
        env: A task's environment, unwrapped.
        row: Which of its rows.
    """
    objects, fronts = range(env.task.objects), range(len(env.task.fronts))
    conditions = (
        *(Condition(held=(k,)) for k in objects),
        *(Condition(placed=(k,)) for k in objects),
        *(Condition(opened=(j,)) for j in fronts),
        *(Condition(closed=(j,)) for j in fronts),
    )
    told = [atoms_of(env.task, c) for c in conditions if bool(env.holds(c)[row])]
    return frozenset().union(*told)


def start_from(env: TaskEnv, row: int = 0) -> frozenset[Atom]:
    """Returns a start to plan anew from: what is observed, and what never changes.

    Args:
        env: A task's environment, unwrapped.
        row: Which of its rows.
    """
    return start_given(env.default_id(), observed(env, row))


def start_given(env_id: str, seen: frozenset[Atom]) -> frozenset[Atom]:
    """Returns a task's start where these atoms hold of what is held, placed, open and closed.

    The robot counts as being nowhere in particular, so that the plan begins by driving.

    Raises:
        PlannerError: Not the id of a task.
    """
    problem = problem_of(env_id)
    changing = {"at", "placed", "holding", "hand-empty", "is-open", "is-closed"}
    kept = {a for a in problem.start if a[0] not in changing or a == ("is-open", ROOM)}
    placed = {("placed", atom[1]) for atom in seen if atom[0] == "at"}
    empty = set() if any(atom[0] == "holding" for atom in seen) else {("hand-empty",)}
    return frozenset(kept | seen | placed | empty)
