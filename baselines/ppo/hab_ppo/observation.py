"""Observations as tensors: a state vector and a stack of images for each row."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from gymnasium import spaces
from torch import Tensor

from hab_tasks.errors import OptionError

IMAGES = "sensor_data"
STATE_GROUPS = ("agent", "extra")
Path = tuple[str, ...]


class Observation(NamedTuple):
    """Observations of N rows.

    Attributes:
        state: (N, S) float32.
        images: (N, C, H, W) uint8 or float32, all cameras stacked on channels; None without.
    """

    state: Tensor
    images: Tensor | None

    def to(self, device: torch.device | str) -> Observation:
        """Returns the observations on a device."""
        images = None if self.images is None else self.images.to(device)
        return Observation(self.state.to(device), images)


@dataclass(frozen=True, kw_only=True)
class ObservationLayout:
    """Which entries of a nested observation a policy sees, in the order of the space.

    Attributes:
        state: Paths of the entries of the state, e.g. ``("agent", "arm_qpos")``.
        state_size: S.
        images: Paths of the images, e.g. ``("sensor_data", "head", "depth")``.
        image_shape: (C, H, W) of the stacked images; None without.
    """

    state: tuple[Path, ...]
    state_size: int
    images: tuple[Path, ...] = ()
    image_shape: tuple[int, int, int] | None = None

    @classmethod
    def of(cls, space: spaces.Space[Any]) -> ObservationLayout:
        """Returns the layout of the space of one row.

        Raises:
            OptionError: Not a nested space with a state.
        """
        boxes = dict(_boxes(space, ()))
        state = tuple(path for path in boxes if path[0] in STATE_GROUPS)
        images = tuple(path for path in boxes if path[0] == IMAGES)
        if not state:
            raise OptionError("The observation has no state; use obs_mode state_dict or depth.")
        shape = None
        if images:
            height, width = boxes[images[0]].shape[:2]
            shape = (sum(boxes[path].shape[2] for path in images), height, width)
        size = sum(math.prod(boxes[path].shape) for path in state)
        return cls(state=state, state_size=size, images=images, image_shape=shape)

    def read(self, obs: Mapping[str, Any]) -> Observation:
        """Returns the tensors of an observation of N rows, given as arrays or tensors."""
        parts = [np.asarray(_at(obs, path), dtype=np.float32) for path in self.state]
        flat = [part.reshape(len(part), -1) for part in parts]
        state = torch.from_numpy(np.concatenate(flat, axis=1))
        if not self.images:
            return Observation(state, None)
        stack = [torch.as_tensor(np.asarray(_at(obs, path))) for path in self.images]
        if any(image.dtype != torch.uint8 for image in stack):
            stack = [image.float() for image in stack]
        return Observation(state, torch.cat(stack, dim=-1).permute(0, 3, 1, 2).contiguous())


def _boxes(space: spaces.Space[Any], path: Path) -> list[tuple[Path, spaces.Box]]:
    """Returns the leaves of a nested space in its order."""
    if isinstance(space, spaces.Dict):
        return [
            leaf for name, inner in space.spaces.items() for leaf in _boxes(inner, (*path, name))
        ]
    return [(path, space)] if isinstance(space, spaces.Box) and path else []


def _at(obs: Mapping[str, Any], path: Path) -> Any:
    value: Any = obs
    for name in path:
        value = value[name]
    return value
