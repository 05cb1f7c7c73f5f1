"""The STRIPS task planner of TP+SRL, SPA and SPA-Priv (S H.1).

Only `hab_planner.solve` needs the planner itself: whoever follows a saved plan does not load it.
"""

from hab_planner.errors import NoPlanError, PlannerError
from hab_planner.plan import Action, Plan, saved_plan
from hab_planner.problem import Atom, TaskProblem, problem_of

__all__ = [
    "Action",
    "Atom",
    "NoPlanError",
    "Plan",
    "PlannerError",
    "TaskProblem",
    "problem_of",
    "saved_plan",
]
