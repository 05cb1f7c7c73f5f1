"""What a vector environment exchanges with its workers: arrays in shared memory, and messages.

A step is the number of its group, each way. Any other answer is None, or the values of `CallRows`.
"""

from __future__ import annotations

import pathlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from torch import Tensor

from hab_tasks.errors import OptionError, UnknownNameError
from hab_tasks.io.shared_arrays import ArraySpec
from hab_tasks.task_spec import TaskSpec

Path = tuple[str, ...]
"""Keys that lead to an entry of a nested dict; () for the value itself."""

ACTION, REWARD, FINAL = "action", "reward", "final"
TERMINATED, TRUNCATED = "terminated", "truncated"


@dataclass(frozen=True, kw_only=True)
class RowLayout:
    """Spaces of one row, and the entries of its `info`.

    Attributes:
        observation_space: Observations of the single environment.
        action_space: Its actions.
        info: Path -> type (a numpy dtype) of every entry of `info` that is a number.
    """

    observation_space: spaces.Space[Any]
    action_space: spaces.Space[Any]
    info: dict[Path, str]

    def chosen_info(self, keys: Sequence[str]) -> tuple[Path, ...]:
        """Returns the entries of `info` that `keys` name, e.g. ``measures``, ``measures.force_n``.

        Raises:
            UnknownNameError: A name that `info` does not have.
        """
        chosen: dict[Path, None] = {}
        for key in keys:
            found = [path for path in self.info if key in (path[0], ".".join(path))]
            if not found:
                valid = {path[0] for path in self.info} | {".".join(path) for path in self.info}
                raise UnknownNameError("entry of info_keys", key, valid)
            chosen |= dict.fromkeys(found)
        return tuple(chosen)

    def arrays(self, count: int, info: Iterable[Path], *, final: bool) -> dict[str, ArraySpec]:
        """Returns the shared arrays of `count` rows, with the entries `info`.

        With `final`, the last observation and info of an episode are kept as well.
        """
        action, boxes = self.action_space, leaves(self.observation_space)
        outputs = {
            **{_name("obs", path): (box.shape, box.dtype) for path, box in boxes.items()},
            **{_name("info", path): ((), self.info[path]) for path in info},
        }
        if final:
            outputs |= {f"{FINAL}/{name}": of for name, of in list(outputs.items())}
        entries = {
            ACTION: (action.shape or (1,), action.dtype),
            REWARD: ((), "float32"),
            TERMINATED: ((), "bool"),
            TRUNCATED: ((), "bool"),
            **outputs,
        }
        return {
            name: ArraySpec(shape=(count, *one), dtype=np.dtype(dtype).str)
            for name, (one, dtype) in entries.items()
        }


def _name(kind: str, path: Path) -> str:
    return "\t".join((kind, *path))


def observation_arrays(
    arrays: Mapping[str, Any], layout: RowLayout, prefix: str = ""
) -> dict[Path, Any]:
    """Returns the arrays of the observation by their path."""
    return {path: arrays[prefix + _name("obs", path)] for path in leaves(layout.observation_space)}


def info_arrays(
    arrays: Mapping[str, Any], info: Iterable[Path], prefix: str = ""
) -> dict[Path, Any]:
    """Returns the arrays of `info` by their path."""
    return {path: arrays[prefix + _name("info", path)] for path in info}


def leaves(space: spaces.Space[Any], path: Path = ()) -> dict[Path, spaces.Box]:
    """Returns the boxes of a space, which may be nested dicts, by their path."""
    if isinstance(space, spaces.Dict):
        found: dict[Path, spaces.Box] = {}
        for name, inner in space.spaces.items():
            found |= leaves(inner, (*path, name))
        return found
    if not isinstance(space, spaces.Box):
        raise OptionError(f"Observations of type {type(space).__name__} cannot be shared.")
    return {path: space}


def entry(value: Any, path: Path) -> Any:
    """Returns the entry of a nested dict at a path."""
    for name in path:
        value = value[name]
    return value


def nested(entries: Mapping[Path, Any]) -> Any:
    """Returns entries by path as nested dicts; a single entry at () is returned itself."""
    if () in entries:
        return entries[()]
    result: dict[str, Any] = {}
    for path, value in entries.items():
        inner = result
        for name in path[:-1]:
            inner = inner.setdefault(name, {})
        inner[path[-1]] = value
    return result


def info_types(info: Mapping[str, Any], path: Path = ()) -> dict[Path, str]:
    """Returns the types of all tensors in an environment's `info` by their path."""
    found: dict[Path, str] = {}
    for name, value in info.items():
        if isinstance(value, Mapping):
            found |= info_types(value, (*path, name))
        elif isinstance(value, Tensor):
            found[(*path, name)] = value.numpy().dtype.str
    return found


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
    """Calls a method of every row's environment, or reads an attribute."""

    name: str
    arguments: tuple[Any, ...] = ()
    named: dict[str, Any]
