"""A candidate start state that does not hold."""

from __future__ import annotations

from hab_tasks.errors import HabError


class RefusedError(HabError):
    """The candidate is dropped and another one drawn; the text is the reason that is counted."""
