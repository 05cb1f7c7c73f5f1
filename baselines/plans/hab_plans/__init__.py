"""The STRIPS task planner of TP+SRL, SPA and SPA-Priv (S H.1).

Only `hab_plans.solve` loads the planner; the plan implied by a task does not need it.
"""

from hab_plans.errors import NoPlanError, PlannerError
from hab_plans.extension import register_action, register_provider
from hab_plans.plan import Action, Plan, plan_of
from hab_plans.problem import Atom, TaskProblem, problem_of

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
