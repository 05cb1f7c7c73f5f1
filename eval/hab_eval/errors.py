"""What can go wrong in an evaluation, beside what `hab_tasks.errors` names."""

from __future__ import annotations

from hab_tasks.errors import HabError


class AgentError(HabError):
    """An agent that cannot be loaded or that breaks the `Agent` protocol."""


class OptionError(HabError):
    """Options of a command that cannot be used, or not together."""


class ResultError(HabError):
    """A result file that does not follow the schema. The message starts with the file's path."""


class RunFolderError(HabError):
    """A result folder that may not be written to, or that belongs to another run."""


class BenchError(HabError):
    """A benchmark that cannot be run as asked."""


class RunStoppedError(HabError):
    """A run that ended before its last episode; the finished ones are kept.

    Attributes:
        details: Traceback of the cause, "" if there is none.
    """

    def __init__(self, message: str, *, details: str = "") -> None:
        super().__init__(message)
        self.details = details
