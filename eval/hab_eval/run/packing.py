"""Observations and actions as messages between an agent's process and its rows' processes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from hab_tasks.privileged import CollisionBody, PrivilegedState

PRIVILEGED = "privileged"
"""Key of the true state in an observation."""


class ObsPacker:
    """Packs observations of rows.

    The bodies of a true state are megabytes of meshes. They are sent once for each row and scene.
    """

    def __init__(self) -> None:
        """Starts with a receiver that has no bodies."""
        self._scene_keys: dict[int, str] = {}

    def pack(self, obs: Any, rows: Sequence[int] = (0,)) -> Any:
        """Returns the observation of these rows as a message for `ObsUnpacker`."""
        message = packed(obs)
        states = _true_states(message)
        if states:
            pairs = zip(rows, states, strict=True)
            message[PRIVILEGED] = [self._without_known_bodies(*pair) for pair in pairs]
        return message

    def _without_known_bodies(self, row: int, state: PrivilegedState) -> PrivilegedState:
        known = self._scene_keys.get(row) == state.scene_key
        self._scene_keys[row] = state.scene_key
        return replace(state, bodies=()) if known else state


class ObsUnpacker:
    """Unpacks observations of rows."""

    def __init__(self) -> None:
        """Starts without bodies."""
        self._bodies: dict[int, tuple[CollisionBody, ...]] = {}

    def unpack(self, message: Any, rows: Sequence[int] = (0,)) -> Any:
        """Returns the observation of these rows that `ObsPacker` packed."""
        obs = unpacked(message)
        states = _true_states(obs)
        if states:
            pairs = zip(rows, states, strict=True)
            obs[PRIVILEGED] = [self._with_bodies(*pair) for pair in pairs]
        return obs

    def _with_bodies(self, row: int, state: PrivilegedState) -> PrivilegedState:
        self._bodies[row] = state.bodies or self._bodies[row]
        return replace(state, bodies=self._bodies[row])


def packed(value: Any) -> Any:
    """Converts tensors of nested groups to arrays; tensors would be sent by shared memory."""
    if isinstance(value, Mapping):
        return {name: packed(part) for name, part in value.items()}
    return value.numpy() if isinstance(value, Tensor) else value


def unpacked(value: Any) -> Any:
    """Inverse of `packed`."""
    if isinstance(value, Mapping):
        return {name: unpacked(part) for name, part in value.items()}
    return torch.from_numpy(value) if isinstance(value, np.ndarray) else value


def _true_states(obs: Any) -> Sequence[PrivilegedState]:
    """Returns the true state of each row, or nothing."""
    return obs.get(PRIVILEGED, ()) if isinstance(obs, Mapping) else ()
