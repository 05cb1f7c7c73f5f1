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
    """Packs the observations of one row.

    The bodies of a true state are megabytes of meshes. They are sent once for each scene.
    """

    def __init__(self) -> None:
        """Starts with a receiver that has no bodies."""
        self._scene_key: str | None = None

    def pack(self, obs: Any) -> Any:
        """Returns the observation as a message for the row's `ObsUnpacker`."""
        message = packed(obs)
        for state in _true_state(message):
            if state.scene_key == self._scene_key:
                message[PRIVILEGED] = [replace(state, bodies=())]
            self._scene_key = state.scene_key
        return message


class ObsUnpacker:
    """Unpacks the observations of one row."""

    def __init__(self) -> None:
        """Starts without bodies."""
        self._bodies: tuple[CollisionBody, ...] = ()

    def unpack(self, message: Any) -> Any:
        """Returns the observation that the row's `ObsPacker` packed."""
        obs = unpacked(message)
        for state in _true_state(obs):
            self._bodies = state.bodies or self._bodies
            obs[PRIVILEGED] = [replace(state, bodies=self._bodies)]
        return obs


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


def _true_state(obs: Any) -> Sequence[PrivilegedState]:
    """Returns the true state of the row, or nothing."""
    return obs.get(PRIVILEGED, ()) if isinstance(obs, Mapping) else ()
