"""Vector environment: W worker processes with K simulations each."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from hab_tasks.engine.inherited_options import check_backend
from hab_tasks.errors import ActionError, OptionError, UnknownNameError
from hab_tasks.option_values import entries, flag, names, seeds, whole
from hab_tasks.vector.layout import (
    ACTION,
    FINAL,
    REWARD,
    TERMINATED,
    TRUNCATED,
    CallRows,
    Path,
    ResetRows,
    WorkerSetup,
    info_arrays,
    nested,
    observation_arrays,
)
from hab_tasks.vector.workers import WorkerTeam

Array = NDArray[Any]
Results = tuple[Any, Array, Array, Array, dict[str, Any]]

MOST_ROWS = 4096
MOST_REPEATS = 1000


class HabVectorEnv(VectorEnv[Any, Any, Any]):
    """Many rows of one environment on the CPU, as `gymnasium.make_vec` returns it.

    Row i equals the single environment reset with seed ``seed + i``, bit for bit, for any number of
    workers. Observations, rewards and `info` are numpy arrays with one entry for each row.

    Args:
        reference: The environment, ``module:X-v1``.
        num_envs: Number of rows.
        num_workers: Number of processes; None for the number of cores, at most one per row.
        num_groups: Number of groups that step independently (see `async_step`).
        info_keys: Entries of `info`: ``success``, ``measures``, ``measures.force_n``, ...
        autoreset_mode: When a row whose episode ended is reset, as in Gymnasium.
        copy: Whether each result is a copy; if not, the next step overwrites it.
        max_episode_steps: Number of steps after which an episode is truncated; None for no
            limit.
        action_repeat: Number of steps for which an action is executed, fewer if the episode
            ends; the reward is their sum, and only the last one is observed and rendered.
        options: Options of the single environment.

    Attributes:
        groups: Rows that can be stepped together, (num_groups,) arrays of row numbers.
        autoreset_mode: When a row whose episode ended is reset.

    Raises:
        OptionError: Invalid number of rows, workers, groups or steps.
        UnknownNameError: Unknown entry of `info_keys`, or unknown option.
        SharedMemoryError: Not enough shared memory.
        VectorWorkerError: A worker process was killed.
    """

    def __init__(
        self,
        reference: str,
        num_envs: int = 1,
        *,
        num_workers: int | None = None,
        num_groups: int = 1,
        info_keys: Sequence[str] = ("success",),
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        copy: bool = True,
        max_episode_steps: int | None = None,
        action_repeat: int = 1,
        **options: Any,
    ) -> None:
        self.num_envs = whole("num_envs", num_envs, 1, MOST_ROWS, "rows")
        workers = _worker_count(num_workers, self.num_envs)
        per_worker = np.array_split(np.arange(self.num_envs), workers)
        most = min(len(rows) for rows in per_worker)
        whole("num_groups", num_groups, 1, most, f"groups, with {workers} workers")
        self._copy = flag("copy", copy)
        self.autoreset_mode = _autoreset(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        check_backend(options.get("sim_backend"))
        self.render_mode = options.get("render_mode")
        parts = [np.array_split(rows, num_groups) for rows in per_worker]
        self.groups = tuple(map(np.concatenate, zip(*parts, strict=True)))
        setup = WorkerSetup(
            reference=reference,
            options=options,
            group_sizes=(),
            max_steps=max_episode_steps,
            autoreset=self.autoreset_mode,
            action_repeat=whole("action_repeat", action_repeat, 1, MOST_REPEATS),
        )
        setups = [replace(setup, group_sizes=tuple(map(len, part))) for part in parts]
        self._team = WorkerTeam(setups, [tuple(int(rows[0]) for rows in part) for part in parts])
        self._connect(names("info_keys", info_keys, ["success", "measures"]))

    def _connect(self, info_keys: Sequence[str]) -> None:
        """Shares the arrays with the workers."""
        self._pending: set[int] = set()
        self._ready = np.zeros(self.num_envs, dtype=bool)
        team = self._team
        with team.closed_on_error():
            layout = team.layout()
            info = layout.chosen_info(info_keys)
            final = self.autoreset_mode is AutoresetMode.SAME_STEP
            arrays = team.share(layout.arrays(self.num_envs, info, final=final), info)
        self.single_observation_space = layout.observation_space
        self.single_action_space = layout.action_space
        self.observation_space = batch_space(layout.observation_space, self.num_envs)
        self.action_space = batch_space(layout.action_space, self.num_envs)
        self._actions = arrays[ACTION]
        self._ends = arrays[REWARD], arrays[TERMINATED], arrays[TRUNCATED]
        self._obs, self._info = observation_arrays(arrays, layout), info_arrays(arrays, info)
        self._final_obs: dict[Path, Array] = {}
        self._final_info: dict[Path, Array] = {}
        if final:
            self._final_obs = observation_arrays(arrays, layout, f"{FINAL}/")
            self._final_info = info_arrays(arrays, info, f"{FINAL}/")

    # Resetting -------------------------------------------------------------------------------

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Starts episodes.

        Args:
            seed: Row i gets ``seed + i``; or one seed for each row. Without any, rows continue
                with their own; in the first reset, one is drawn.
            options: ``reset_mask``, (N,) bool, restricts the reset to some rows; ``episode``, an
                `Episode` or its index, for all rows or a list with one for each; other options go
                to every row.

        Returns:
            Observations and `info` of all rows.

        Raises:
            OptionError: Invalid seed, mask or option.
            EpisodeError: Unknown episode.
        """
        self._check_open()
        self._check_idle("reset")
        options = entries("options", options)
        rows = self._masked(options.pop("reset_mask", None))
        row_seeds = self._row_seeds(seed)
        episode = options.pop("episode", None)
        wishes = episode if isinstance(episode, (list, tuple)) else [episode] * self.num_envs
        if len(wishes) != self.num_envs:
            raise OptionError.of_value("episode", episode, f"one, or {self.num_envs} in a list")
        given = {
            row: options | ({} if wishes[row] is None else {"episode": wishes[row]}) for row in rows
        }
        self._ready[rows] = False
        self._team.ask(ResetRows(seeds={row: row_seeds[row] for row in rows}, options=given))
        self._ready[rows] = True
        for ends in self._ends:
            ends[rows] = 0
        return self._taken(self._obs), self._infos(self._info)

    def _row_seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        """Returns the seed of each row."""
        if seed is None and not self._ready.any():
            seed = int(self.np_random.integers(2**31))
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, Sequence | np.ndarray):
            if len(seed) != self.num_envs:
                raise OptionError.of_value("seed", seed, f"one, or {self.num_envs} in a list")
            seeds("seed", [one for one in seed if one is not None] or None, self.num_envs)
            return [None if one is None else int(one) for one in seed]
        first = int(whole("seed", seed, 0, 2**32 - self.num_envs))
        super().reset(seed=first)
        return [first + row for row in range(self.num_envs)]

    def _masked(self, mask: Any) -> list[int]:
        """Returns the rows of a mask; all without one."""
        if mask is None:
            return list(range(self.num_envs))
        array = np.asarray(mask)
        if array.shape != (self.num_envs,) or array.dtype != bool or not array.any():
            valid = f"an array of {self.num_envs} booleans, one of them True"
            raise OptionError.of_value("reset_mask", mask, valid)
        return np.flatnonzero(array).tolist()

    # Stepping --------------------------------------------------------------------------------

    def step(self, actions: Any) -> Results:
        """Executes one action in every row.

        Returns:
            Observations, rewards (N,), terminated (N,), truncated (N,) and `info`.

        Raises:
            ActionError: Wrong shape, or an entry that is not finite.
        """
        self._send(range(len(self.groups)), self._checked(actions, self.num_envs), None)
        return self._receive(range(len(self.groups)), None)

    def async_step(self, rows: Array, actions: Any) -> None:
        """Starts a step of one of `groups`; `wait` returns its results.

        The rows of the other groups can be stepped meanwhile.
        """
        group = self._group(rows)
        self._send([group], self._checked(actions, len(rows)), self.groups[group])

    def wait(self, rows: Array) -> Results:
        """Returns the results of `async_step` for the same rows, in their order."""
        group = self._group(rows)
        if group not in self._pending:
            raise OptionError(f"Group {group} is not being stepped; call async_step first.")
        return self._receive([group], self.groups[group])

    def _send(self, groups: Sequence[int] | range, actions: Array, rows: Array | None) -> None:
        self._check_open()
        self._check_idle("step", groups)
        chosen = slice(None) if rows is None else rows
        if not self._ready[chosen].all():
            raise ResetNeeded("Call reset before step.")
        if self.autoreset_mode is AutoresetMode.DISABLED:
            ended = (self._ends[1] | self._ends[2])[chosen]
            if ended.any():
                numbers = np.arange(self.num_envs)[chosen][ended].tolist()
                raise ResetNeeded(
                    f"The episodes of rows {numbers} have ended; reset them: "
                    "reset(options={'reset_mask': terminated | truncated})."
                )
        self._actions[chosen] = actions
        self._pending |= set(groups)
        self._team.start_step(groups)

    def _receive(self, groups: Sequence[int] | range, rows: Array | None) -> Results:
        self._team.finish_step(groups)
        self._pending -= set(groups)
        reward, terminated, truncated = (self._take(array, rows) for array in self._ends)
        infos = self._infos(self._info, rows)
        if self._final_obs:
            infos |= self._final(terminated | truncated, rows)
        return self._taken(self._obs, rows), reward, terminated, truncated, infos

    def _checked(self, actions: Any, count: int) -> Array:
        """Returns valid actions (count, A)."""
        space = self.single_action_space
        try:
            array = np.asarray(actions)
            kept = array.astype(space.dtype)
        except (TypeError, ValueError) as error:
            raise ActionError(f"Actions are not an array of numbers ({error}).") from error
        if space.shape == () and array.shape == (count, 1):
            kept = kept[:, 0]
        if kept.shape != (count, *(space.shape or ())):
            expected = (count, *(space.shape or ()))
            raise ActionError(f"Actions of shape {array.shape}; expected {expected}.")
        cells = getattr(space, "n", None)
        if cells is not None:
            if not ((kept == array.reshape(kept.shape)) & (kept >= 0) & (kept < cells)).all():
                raise ActionError(f"Actions {array.tolist()}; valid cells are 0 to {cells - 1}.")
            return kept[:, None]
        finite = np.isfinite(kept).reshape(count, -1).all(axis=1)
        if not finite.all():
            row = int(np.flatnonzero(~finite)[0])
            raise ActionError(f"Action {row} has a non-finite value: {kept[row].tolist()}.")
        return kept

    def _group(self, rows: Any) -> int:
        for number, group in enumerate(self.groups):
            if np.array_equal(rows, group):
                return number
        valid = f"one of the {len(self.groups)} arrays in env.groups (see num_groups)"
        raise OptionError.of_value("rows", rows, valid)

    # Results ---------------------------------------------------------------------------------

    def _take(self, array: Array, rows: Array | None) -> Array:
        if rows is not None:
            return array[rows]
        return array.copy() if self._copy else array

    def _taken(self, arrays: dict[Path, Array], rows: Array | None = None) -> Any:
        return nested({path: self._take(array, rows) for path, array in arrays.items()})

    def _infos(self, arrays: dict[Path, Array], rows: Array | None = None) -> dict[str, Any]:
        """Returns `info`; as in Gymnasium, ``_name`` says which rows have ``name``: all."""
        infos: dict[str, Any] = self._taken(arrays, rows) if arrays else {}
        count = self.num_envs if rows is None else len(rows)
        return _with_masks(infos, np.ones(count, dtype=bool))

    def _final(self, ended: Array, rows: Array | None) -> dict[str, Any]:
        """Returns the last observations and `info` of the rows whose episodes ended."""
        if not ended.any():
            return {}
        numbers = np.arange(self.num_envs) if rows is None else rows
        last = np.full(len(ended), None, dtype=object)
        for here in np.flatnonzero(ended):
            row = numbers[here]
            last[here] = nested({p: array[row].copy() for p, array in self._final_obs.items()})
        infos: dict[str, Any] = (
            nested({path: array[numbers] for path, array in self._final_info.items()})
            if self._final_info
            else {}
        )
        return {
            "final_obs": last,
            "_final_obs": ended.copy(),
            "final_info": _with_masks(infos, ended),
            "_final_info": ended.copy(),
        }

    # Access to the rows ----------------------------------------------------------------------

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Calls a method of every row's environment, or reads an attribute; returns the results."""
        self._check_open()
        self._check_idle("call")
        return tuple(self._team.ask(CallRows(name=name, arguments=args, named=kwargs)))

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Returns an attribute of every row's environment."""
        return self.call(name)

    def render(self) -> tuple[Any, ...] | None:
        """Returns a frame (H, W, 3) uint8 of each row; requires a `render_mode`."""
        frames = self.call("render")
        return tuple(np.asarray(frame)[0] for frame in frames)

    @property
    def worker_pids(self) -> tuple[int, ...]:
        """Process ids of the workers."""
        return self._team.pids

    def close_extras(self, **kwargs: Any) -> None:
        """Ends the workers."""
        if hasattr(self, "_team"):
            self._team.close()

    def _check_open(self) -> None:
        if self.closed or self._team.closed:
            raise ClosedEnvironmentError("The vector environment is closed; make a new one.")

    def _check_idle(self, action: str, groups: Sequence[int] | range | None = None) -> None:
        busy = self._pending if groups is None else self._pending & set(groups)
        if busy:
            raise OptionError(
                f"Groups {sorted(busy)} are still being stepped; call wait before {action}."
            )


def _with_masks(infos: dict[str, Any], mask: Array) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for name, value in infos.items():
        result[name] = _with_masks(value, mask) if isinstance(value, dict) else value
        result[f"_{name}"] = mask
    return result


def _worker_count(wanted: int | None, rows: int) -> int:
    """Returns the number of workers; at most one for each row."""
    if wanted is None:
        return min(len(os.sched_getaffinity(0)), rows)
    return whole("num_workers", wanted, 1, rows, "processes, at most one for each row,")


def _autoreset(mode: AutoresetMode | str) -> AutoresetMode:
    if isinstance(mode, AutoresetMode):
        return mode
    found = {one.value: one for one in AutoresetMode} | {one.name: one for one in AutoresetMode}
    if mode not in found:
        raise UnknownNameError("autoreset_mode", mode, [one.value for one in AutoresetMode])
    return found[mode]
