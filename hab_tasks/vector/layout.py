"""Layout of what a vector environment exchanges with its workers: actions, observations, info."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces
from torch import Tensor

from hab_tasks.errors import OptionError, UnknownNameError
from hab_tasks.io.shared_arrays import ArraySpec

Path = tuple[str, ...]
"""Keys that lead to an entry of a nested dict; () for the value itself."""

ACTION, REWARD, TERMINATED, TRUNCATED, FINAL = (
    "action",
    "reward",
    "terminated",
    "truncated",
    "final",
)


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
        """Returns the entries of `info` that `keys` name.

        Args:
            keys: ``success``; a group, ``measures``; or one entry of a group,
                ``measures.force_n``.

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
        """Returns the shared arrays of `count` rows.

        Args:
            count: Number of rows.
            info: Entries of `info`.
            final: Whether the last observation and info of an episode are kept as well.
        """
        action = self.action_space
        shape = action.shape or (1,)
        outputs = {
            **{_name("obs", p): (box.shape, box.dtype) for p, box in self.observations().items()},
            **{_name("info", path): ((), self.info[path]) for path in info},
        }
        if final:
            outputs |= {f"{FINAL}/{name}": of for name, of in list(outputs.items())}
        entries = {
            ACTION: (shape, action.dtype),
            REWARD: ((), "float32"),
            TERMINATED: ((), "bool"),
            TRUNCATED: ((), "bool"),
            **outputs,
        }
        return {
            name: ArraySpec(shape=(count, *one), dtype=np.dtype(dtype).str)
            for name, (one, dtype) in entries.items()
        }

    def observations(self) -> dict[Path, spaces.Box]:
        """Returns the boxes of the observation by their path."""
        return leaves(self.observation_space)


def _name(kind: str, path: Path) -> str:
    return "\t".join((kind, *path))


def observation_arrays(
    arrays: Mapping[str, Any], layout: RowLayout, prefix: str = ""
) -> dict[Path, Any]:
    """Returns the arrays of the observation by their path."""
    return {path: arrays[prefix + _name("obs", path)] for path in layout.observations()}


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
