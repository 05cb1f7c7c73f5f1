"""Observations as agents receive them: ground-truth state and images are read on demand."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from hab_eval.errors import AgentError
from hab_tasks.agent import AgentSpec

if TYPE_CHECKING:
    import gymnasium as gym

IMAGES = ("sensor_param", "sensor_data")
"""Groups of an observation that need rendering."""

Reader = Callable[[], Mapping[str, Any]]
"""Reads groups of an observation from the environment."""


class LazyObservation(Mapping[str, Any]):
    """An observation of which some groups are read on first access and then cached."""

    def __init__(self, ready: Mapping[str, Any], readers: Mapping[str, Reader]) -> None:
        """Takes the groups that are there, and of each other group what reads it."""
        self._groups = dict(ready)
        self._readers = readers
        self._names = (*ready, *readers)
        self._past = False

    def __getitem__(self, key: str) -> Any:
        if key not in self._groups and key in self._readers:
            if self._past:
                raise AgentError(f"obs[{key!r}] can be read only until the next step.")
            self._groups.update(self._readers[key]())
        return self._groups[key]

    def __contains__(self, key: object) -> bool:
        return key in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    @property
    def unread(self) -> tuple[str, ...]:
        """Names of the groups that were not read yet."""
        return tuple(name for name in self._names if name not in self._groups)

    def of_rows(self, rows: Sequence[int]) -> Mapping[str, Any]:
        """See `hab_tasks.agent.of_rows`; there is one row."""
        return self

    def expire(self) -> None:
        """Forbids reading further groups from now on: the simulation is about to step."""
        self._past = True


class LazyBatch(Mapping[str, Any]):
    """The observation of several rows, whose groups are concatenated on first access."""

    def __init__(self, rows: Sequence[LazyObservation]) -> None:
        """Takes the observations of the rows."""
        self._rows = rows
        self._ready: dict[str, Any] = {}

    def __getitem__(self, key: str) -> Any:
        if key not in self._ready:
            self._ready[key] = batched([row[key] for row in self._rows])
        return self._ready[key]

    def __contains__(self, key: object) -> bool:
        return key in self._rows[0]

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows[0])

    def __len__(self) -> int:
        return len(self._rows[0])

    @property
    def unread(self) -> tuple[str, ...]:
        """Names of the groups that are not read yet in all rows."""
        return tuple(dict.fromkeys(name for row in self._rows for name in row.unread))

    def of_rows(self, rows: Sequence[int]) -> Mapping[str, Any]:
        """See `hab_tasks.agent.of_rows`."""
        chosen = [self._rows[row] for row in rows]
        return chosen[0] if len(chosen) == 1 else LazyBatch(chosen)


def batched(values: Sequence[Any]) -> Any:
    """Concatenates N observations of one row; tensors (1, ...) become (N, ...)."""
    first = values[0]
    if len(values) == 1:
        return first
    if isinstance(first, LazyObservation):
        return LazyBatch(values)
    if isinstance(first, Tensor):
        return torch.cat(list(values))
    if isinstance(first, Mapping):
        return {name: batched([value[name] for value in values]) for name in first}
    return [item for value in values for item in value]  # ground-truth states: lists of one entry


class AgentView:
    """Observations of an environment as an agent with a spec receives them."""

    def __init__(self, spec: AgentSpec) -> None:
        """Takes the agent's spec."""
        self._spec = spec
        self._last: Mapping[str, Any] = {}

    def __call__(self, env: gym.Env[Any, Any], obs: Mapping[str, Any]) -> Mapping[str, Any]:
        """Returns the observation after a reset or step; the one before can be read no more."""
        if isinstance(self._last, LazyObservation):
            self._last.expire()
        base: Any = env.unwrapped
        if self._spec.instruction == "task":
            obs = {**obs, "instruction": base.instruction}
        elif self._spec.instruction == "stage":
            obs = {**obs, "instruction": base.stage_instruction}
        readers: dict[str, Reader] = {}
        if self._spec.privileged:
            readers["privileged"] = lambda: {"privileged": base.privileged()}
        if self._spec.looks == "on demand":
            readers |= dict.fromkeys(IMAGES, base.look)
        self._last = LazyObservation(obs, readers) if readers else obs
        return self._last
