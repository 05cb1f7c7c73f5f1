"""What can go wrong in planning."""

from __future__ import annotations

from hab_tasks.errors import HabError


class PlannerError(HabError):
    """A task that has no problem, or a plan that does not fit its problem."""


class NoPlanError(PlannerError):
    """The goal cannot be reached from the start, by proof."""
