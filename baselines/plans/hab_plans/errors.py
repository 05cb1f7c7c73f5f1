"""Errors of the task planner."""

from __future__ import annotations

from hab_tasks.errors import HabError


class PlannerError(HabError):
    """Not a task, or a plan that does not fit its problem."""


class NoPlanError(PlannerError):
    """The goal is provably unreachable from the initial state."""
