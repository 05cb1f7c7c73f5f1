"""Noise of depth, colour and joint-angle sensors, reproducible in replays of an episode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
import torch
from torch import Tensor

from hab_tasks.arrays import Floats
from hab_tasks.engine.recorded_state import joined, words_of
from hab_tasks.errors import OptionError
from hab_tasks.option_values import number, settings

Images = dict[str, dict[str, Tensor]]

_COLOURS = ("rgb", "Color")
_RANGES = ("depth", "position", "Position", "PositionSegmentation")
"""Images with colours and with distances; capitalised names are raw shader textures."""


@dataclass(frozen=True, kw_only=True)
class SensorNoise:
    """Standard deviations of the sensor noise; 0 is noise-free.

    Attributes:
        depth_at_1_m_m: Depth at 1 m; grows with the square of the distance. (The default gives
            4 cm at 5 m, as with a structured-light camera.)
        rgb_levels: Each colour channel, in levels of 256.
        joint_rad: Each joint angle of the arm.
    """

    depth_at_1_m_m: float = 0.0016
    rgb_levels: float = 2.0
    joint_rad: float = 0.001

    def __post_init__(self) -> None:
        """Rejects values that are not standard deviations."""
        for field in fields(self):
            value = getattr(self, field.name)
            name, valid = f"sensor_noise.{field.name}", "a number from 0"
            if number(name, value, valid) < 0.0:
                raise OptionError.of_value(name, value, valid)

    @classmethod
    def of(cls, noise: SensorNoise | Mapping[str, float] | None) -> SensorNoise | None:
        """Returns the noise of an option's value: a mapping of attributes, as in JSON, or None.

        Raises:
            UnknownNameError: The mapping has an unknown attribute.
            OptionError: Invalid type, or a value that is not a standard deviation.
        """
        return settings("sensor_noise", noise, cls)


class NoiseSource:
    """Adds noise to the sensors of one row.

    Every draw has its own generator, seeded by episode, step and sensor. Reading a sensor twice
    gives the same values, replays are identical on any device, and rows are independent.
    """

    def __init__(self, noise: SensorNoise) -> None:
        """Starts at step 0 of an episode with seed 0."""
        self.noise = noise
        self._seed, self._step = 0, 0

    def begin(self, seed: int) -> None:
        """Restarts with the seed of an episode."""
        self._seed, self._step = seed, 0

    def advance(self) -> None:
        """Advances by one step."""
        self._step += 1

    def joints(self, qpos_rad: Floats) -> Floats:
        """Returns noisy joint angles (J,) [rad]."""
        return qpos_rad + self.noise.joint_rad * self._normal(0, qpos_rad.shape)

    def images(self, data: Images) -> Images:
        """Returns noisy images of each camera: name -> (1, H, W, C)."""
        return {
            # Stream 0 is that of the joints; a camera has one for colours and one for ranges.
            camera: {name: self._image(2 * number + 1, name, image) for name, image in each.items()}
            for number, (camera, each) in enumerate(data.items())
        }

    def _image(self, stream: int, name: str, image: Tensor) -> Tensor:
        height, width = image.shape[1:3]
        if name in _COLOURS:
            normal = self._tensor(stream, (height, width, 3), image.device)
            return _coloured(image, self.noise.rgb_levels * normal)
        if name in _RANGES:
            # All textures derived from a camera's distances share one error.
            normal = self._tensor(stream + 1, (height, width, 1), image.device)
            return _ranged(image, self.noise.depth_at_1_m_m * normal)
        return image

    def _normal(self, stream: int, shape: tuple[int, ...]) -> Floats:
        """Draws from the standard normal distribution."""
        drawn = np.random.default_rng((self._seed, self._step, stream))
        return drawn.standard_normal(shape, dtype=np.float32)

    def _tensor(self, stream: int, shape: tuple[int, ...], device: torch.device) -> Tensor:
        """Draws a tensor (1, *shape)."""
        return torch.from_numpy(self._normal(stream, shape))[None].to(device)

    def get_state(self) -> dict[str, Tensor]:
        """Returns the episode's seed in words of 16 bits, (1, 4), and the step, (1,)."""
        return {"seeds": words_of([self._seed], 4), "steps": torch.tensor([self._step])}

    def set_state(self, state: Mapping[str, Tensor]) -> None:
        """Restores a state of `get_state`."""
        (self._seed,), self._step = joined(state["seeds"]), int(state["steps"][0])


def _coloured(image: Tensor, levels: Tensor) -> Tensor:
    """Adds levels of 256 (N, H, W, 3) to an image (N, H, W, C): uint8, or float in [0, 1]."""
    if image.is_floating_point():
        noisy = (image[..., :3] + levels / 255.0).clamp(0.0, 1.0)
    else:
        noisy = (image[..., :3] + levels).round().clamp(0, 255).to(image.dtype)
    return torch.cat((noisy, image[..., 3:]), dim=-1)


def _ranged(image: Tensor, per_m: Tensor) -> Tensor:
    """Moves points along their rays by `per_m` (N, H, W, 1) [m] times the square of their depth.

    The image is depth (N, H, W, 1), or position (N, H, W, 3 or 4; z backwards) with its extra
    channel. Integers are millimetres, floats metres. Zero (no return) stays zero.
    """
    depth = image if image.shape[-1] == 1 else -image[..., 2:3]
    depth_m = depth if image.is_floating_point() else depth / 1000.0
    # Clamped, as a draw may not move a point behind the camera.
    noisy = image[..., :3] * (1.0 + per_m * depth_m).clamp(min=0.0)
    if not image.is_floating_point():
        bounds = torch.iinfo(image.dtype)
        noisy = noisy.round().clamp(bounds.min, bounds.max).to(image.dtype)
    return torch.cat((noisy, image[..., 3:]), dim=-1)
