"""Messages between a vector environment and its workers.

A step is the number of its group, each way; observations, actions and results are in shared memory.
Any other answer is None, or the values of `CallRows`.
"""

from __future__ import annotations

import pathlib
from dataclasses import dataclass
from typing import Any

from gymnasium.vector import AutoresetMode

from hab_tasks.io.shared_arrays import ArraySpec
from hab_tasks.task_spec import TaskSpec
from hab_tasks.vector.layout import Path


@dataclass(frozen=True, kw_only=True)
class WorkerSetup:
    """What a worker builds.

    Attributes:
        reference: The environment, ``module:X-v1``.
        options: Options of `gymnasium.make`.
        group_sizes: Number of its rows in each group.
        max_steps: Number of steps after which an episode is truncated; None for no limit.
        autoreset: When rows are reset.
        action_repeat: Number of steps for which an action is executed.
        episodes_folder: Where the workers share the episodes they generate.
        task: A task that the main script declares.
    """

    reference: str
    options: dict[str, Any]
    group_sizes: tuple[int, ...]
    max_steps: int | None
    autoreset: AutoresetMode
    action_repeat: int = 1
    episodes_folder: pathlib.Path | None = None
    task: TaskSpec | None = None


@dataclass(frozen=True, kw_only=True)
class Connect:
    """The shared arrays; the descriptor of their file follows.

    Attributes:
        specs: Arrays of all rows.
        info: Entries of `info`.
        starts: First row of each of the worker's groups.
    """

    specs: dict[str, ArraySpec]
    info: tuple[Path, ...]
    starts: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class ResetRows:
    """Resets rows of the worker.

    Attributes:
        seeds: Row -> its seed, None to continue with the row's own.
        options: Row -> options of the reset.
    """

    seeds: dict[int, int | None]
    options: dict[int, dict[str, Any]]


@dataclass(frozen=True, kw_only=True)
class CallRows:
    """Calls a method of every row's environment, or reads an attribute.

    Attributes:
        name: Its name.
        arguments: Positional arguments.
        named: Keyword arguments.
    """

    name: str
    arguments: tuple[Any, ...] = ()
    named: dict[str, Any]
