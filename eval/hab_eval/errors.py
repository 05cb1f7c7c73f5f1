"""Errors of the evaluator, in addition to `hab_tasks.errors`."""

from __future__ import annotations

from hab_tasks.errors import HabError


class AgentError(HabError):
    """An agent that cannot be loaded or that breaks the `Agent` protocol."""


class ResultError(HabError):
    """A result file that violates the schema. The message starts with the file's path."""


class RunFolderError(HabError):
    """A run folder that is in use, not empty, or belongs to another run."""


class BenchError(HabError):
    """A benchmark that cannot be run."""
