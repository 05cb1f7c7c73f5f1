"""Writes observations, rewards, ends and info of a group of rows into shared arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hab_tasks.engine.hab_env import HabEnv
from hab_tasks.engine.rows import Rows, read_entries
from hab_tasks.engine.rules import Evaluation
from hab_tasks.engine.sensors import ObsEntry
from hab_tasks.vector.layout import (
    FINAL,
    REWARD,
    TERMINATED,
    TRUNCATED,
    Path,
    RowLayout,
    entry,
    info_arrays,
    observation_arrays,
)

Array = NDArray[Any]


class GroupOutputs:
    """Results of one group of rows.

    Attributes:
        ended: (K,) whether the episode of each row has ended.
    """

    def __init__(
        self,
        envs: Sequence[HabEnv],
        layout: RowLayout,
        arrays: Mapping[str, Array],
        info: Sequence[Path],
        max_steps: int | None,
    ) -> None:
        """Writes to `arrays` (see `RowLayout.arrays`), (K, ...) each, of the joined environments.

        An episode is truncated after `max_steps`, if not None.
        """
        first = envs[0]
        self._envs, self._rows, self._max_steps = envs, first.rows, max_steps
        self._mode, self._bound = first.reward_mode, first.reward_bound
        self._reward, self._terminated = arrays[REWARD], arrays[TERMINATED]
        self._truncated = arrays[TRUNCATED]
        observation = observation_arrays(arrays, layout)
        self._info = info_arrays(arrays, info)
        self._entries = _EntryWriter(first.entries, observation, self._rows)
        self._images = {p: a for p, a in observation.items() if p not in self._entries.paths}
        self._final = []
        if any(name.startswith(FINAL) for name in arrays):
            last = observation_arrays(arrays, layout, f"{FINAL}/")
            last_info = info_arrays(arrays, info, f"{FINAL}/")
            pairs = [(observation[path], last[path]) for path in observation]
            self._final = [*pairs, *((self._info[path], last_info[path]) for path in self._info)]
        self.ended = np.zeros(len(envs), dtype=bool)

    def write_images(self, row: int, obs: Any = None) -> None:
        """Renders and writes the images of a row, or those of its observation `obs`."""
        if self._images:
            shown = self._envs[row].get_obs({}) if obs is None else obs
            for path, array in self._images.items():
                array[row] = entry(shown, path)[0]

    def begin_step(self) -> None:
        """Sets rewards and ends of all rows to zero."""
        for array in (self._reward, self._terminated, self._truncated, self.ended):
            array[:] = 0

    def add_step(self, rows: Sequence[int]) -> None:
        """Adds the rewards of one simulation step of `rows`, and writes their ends and info."""
        result, chosen = self._rows.rules.evaluate(), self._index(rows)
        self._reward[chosen] += self._rewards(result)[chosen]
        self._terminated[chosen] = (result.success | result.fail)[chosen]
        if self._max_steps is not None:
            self._truncated[chosen] = self._rows.steps[chosen] >= self._max_steps
        np.logical_or(self._terminated, self._truncated, out=self.ended)
        self._write_info(result, chosen)

    def write_info(self, rows: Sequence[int]) -> None:
        """Writes the info of `rows`."""
        self._write_info(self._rows.rules.evaluate(), self._index(rows))

    def write_entries(self) -> None:
        """Writes the state observation of all rows."""
        self._entries.write()

    def write_reset(self) -> None:
        """Writes observations and info after resets of some rows."""
        self._write_info(self._rows.rules.evaluate(), slice(None))
        self._entries.write()

    def keep_final(self, rows: Sequence[int]) -> None:
        """Copies observation and info of `rows`, before these rows are reset."""
        for source, kept in self._final:
            kept[rows] = source[rows]

    def _rewards(self, result: Evaluation) -> Array:
        if self._mode == "none":
            return np.zeros_like(self._reward)
        if self._mode == "sparse":
            return result.success.astype(np.float32) - result.fail.astype(np.float32)
        reward = result.reward.astype(np.float32)
        if self._mode == "normalized_dense":
            return np.minimum(reward / self._bound, np.float32(1.0))
        return reward

    def _index(self, rows: Sequence[int]) -> slice | list[int]:
        """Returns an index of `rows` into the arrays; a slice, which is faster, for all rows."""
        return slice(None) if len(rows) == len(self._envs) else list(rows)

    def _write_info(self, result: Evaluation, rows: slice | list[int]) -> None:
        for path, array in self._info.items():
            if path == ("elapsed_steps",):
                values = self._rows.steps
            elif len(path) == 1:
                values = getattr(result, path[0])
            else:
                # Terms that cannot be paid in this step are zero.
                values = result.groups[path[0]].get(path[1], 0.0)
            array[rows] = np.broadcast_to(values, array.shape)[rows]


class _EntryWriter:
    """Writes the entries of the state observation, at these paths."""

    def __init__(
        self, entries: Sequence[ObsEntry], observation: Mapping[Path, Array], rows: Rows
    ) -> None:
        self._rows = rows
        flat = next((path for path in ((), ("state",)) if path in observation), None)
        self.paths: list[Path] = [] if flat is None else [flat]
        self._targets: list[tuple[ObsEntry, Array]] = []
        start = 0
        for one in entries:
            size = int(np.prod(one.shape))
            if flat is None:
                self.paths.append((one.group, one.name))
                self._targets.append((one, observation[one.group, one.name]))
            else:
                self._targets.append((one, observation[flat][:, start : start + size]))
            start += size

    def write(self) -> None:
        """Writes all rows."""
        values = read_entries([one for one, _ in self._targets], self._rows)
        for one, array in self._targets:
            array[:] = values[one.name].reshape(array.shape)
