"""The STRIPS task planner of TP+SRL, SPA and SPA-Priv (S H.1).

Only `hab_plans.solve` loads the planner; the plan implied by a task does not need it.
"""

from hab_plans.plan import Action, Plan, plan_of
from hab_plans.problem import (
    Atom,
    NoPlanError,
    PlannerError,
    TaskProblem,
    problem_of,
    register_action,
    register_provider,
)

__all__ = [
    "Action",
    "Atom",
    "NoPlanError",
    "Plan",
    "PlannerError",
    "TaskProblem",
    "plan_of",
    "problem_of",
    "register_action",
    "register_provider",
]
