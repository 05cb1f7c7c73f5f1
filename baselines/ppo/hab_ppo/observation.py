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
from torch.nn.functional import avg_pool2d

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
    """Which entries of a nested observation a policy sees, in the order of their paths.

    The order does not depend on that of the space, in which two environments with the same
    observations may differ.

    Attributes:
        state: Paths of the entries of the state, e.g. ``("agent", "arm_qpos")``.
        state_sizes: Sizes of these entries.
        images: Paths of the images, e.g. ``("sensor_data", "head", "depth")``.
        image_shape: (C, H, W) of the stacked images as they are read; None without.
        image_block_px: Side of the blocks of pixels that are averaged when images are read.
    """

    state: tuple[Path, ...]
    state_sizes: tuple[int, ...]
    images: tuple[Path, ...] = ()
    image_shape: tuple[int, int, int] | None = None
    image_block_px: int = 1

    @classmethod
    def of(cls, space: spaces.Space[Any], image_block_px: int = 1) -> ObservationLayout:
        """Returns the layout of the space of one row.

        Args:
            space: The space.
            image_block_px: Side of the blocks of pixels that are averaged.

        Raises:
            OptionError: Not a nested space with a state, or images that the blocks do not fill.
        """
        boxes = dict(sorted(_boxes(space, ())))
        state = tuple(path for path in boxes if path[0] in STATE_GROUPS)
        images = tuple(path for path in boxes if path[0] == IMAGES)
        if not state:
            raise OptionError("The observation has no state; use obs_mode state_dict or depth.")
        shape = None
        if images:
            height, width = boxes[images[0]].shape[:2]
            if image_block_px < 1 or height % image_block_px or width % image_block_px:
                raise OptionError(
                    f"image_block_px {image_block_px} does not divide images of {width} x {height} "
                    "pixels."
                )
            channels = sum(boxes[path].shape[2] for path in images)
            shape = (channels, height // image_block_px, width // image_block_px)
        sizes = tuple(math.prod(boxes[path].shape) for path in state)
        return cls(
            state=state,
            state_sizes=sizes,
            images=images,
            image_shape=shape,
            image_block_px=image_block_px,
        )

    @property
    def state_size(self) -> int:
        """S, the size of the state."""
        return sum(self.state_sizes)

    def start_of(self, path: Path) -> int | None:
        """Returns where an entry starts in the state; None without it."""
        if path not in self.state:
            return None
        return sum(self.state_sizes[: self.state.index(path)])

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
        stacked = torch.cat(stack, dim=-1).permute(0, 3, 1, 2)
        return Observation(state, averaged(stacked, self.image_block_px).contiguous())


def averaged(images: Tensor, block_px: int) -> Tensor:
    """Returns images (N, C, H, W) with square blocks of pixels averaged; the type is kept."""
    if block_px == 1:
        return images
    means = avg_pool2d(images.float(), block_px)
    return means if images.is_floating_point() else means.round().to(images.dtype)


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
