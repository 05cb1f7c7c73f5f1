"""Errors of the trainer."""

from __future__ import annotations

from hab_tasks.errors import HabError


class PolicyFileError(HabError):
    """A file of weights or a checkpoint that cannot be used."""


class RecipeError(HabError):
    """A recipe that cannot be trained as asked."""
