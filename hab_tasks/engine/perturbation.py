"""Perturbations that test how robust an agent is: cameras, friction, light, clutter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import sapien
from mani_skill.sensors.base_sensor import BaseSensor
from torch import Tensor
from transforms3d import quaternions

from hab_tasks.errors import OptionError
from hab_tasks.option_values import number, settings, whole
from hab_tasks.robots.cameras import pose_params, specified_pose
from hab_tasks.simulator import move_camera

MOST_CLUTTER = 50


@dataclass(frozen=True, kw_only=True)
class Perturbation:
    """Differences from the paper's protocol; the default has none.

    Attributes:
        camera_m: Distance of each camera from its place, in a direction drawn per episode.
        camera_rad: Angle by which each camera is turned, about an axis drawn per episode.
            ``sensor_param`` tells neither: it has the cameras as they are specified.
        friction: Factor of the friction coefficients of movable objects.
        light: Factor of the brightness of all lamps, for colour images.
        clutter: Number of objects added where an episode's objects start and go, fewer if there is
            no room; everything else in the episode stays as it is.
    """

    camera_m: float = 0.0
    camera_rad: float = 0.0
    friction: float = 1.0
    light: float = 1.0
    clutter: int = 0

    def __post_init__(self) -> None:
        """Rejects values out of range."""
        for name in ("camera_m", "camera_rad", "friction", "light"):
            option, value = f"perturbation.{name}", getattr(self, name)
            if number(option, value, "a number from 0") < 0.0:
                raise OptionError.of_value(option, value, "a number from 0")
        whole("perturbation.clutter", self.clutter, 0, MOST_CLUTTER, "objects")

    @property
    def moves_cameras(self) -> bool:
        """Whether cameras are displaced."""
        return self.camera_m > 0.0 or self.camera_rad > 0.0

    @classmethod
    def of(cls, value: Perturbation | Mapping[str, float] | None) -> Perturbation:
        """Returns the perturbation of an option's value: a mapping of attributes, or None.

        Raises:
            UnknownNameError: The mapping has an unknown attribute.
            OptionError: Invalid type, or a value out of range.
        """
        return settings("perturbation", value, cls) or cls()


def displace(cameras: Mapping[str, BaseSensor], perturbation: Perturbation, seed: int) -> None:
    """Displaces cameras for an episode, whose seed determines where to."""
    for place, camera in enumerate(cameras.values()):
        directions = np.random.default_rng((seed, place)).standard_normal((2, 3))
        offset, axis = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        turn = quaternions.axangle2quat(axis, perturbation.camera_rad)
        error = sapien.Pose((perturbation.camera_m * offset).tolist(), turn.tolist())
        move_camera(camera, specified_pose(camera) * error)


def as_specified(
    params: dict[str, dict[str, Tensor]], cameras: Mapping[str, BaseSensor]
) -> dict[str, dict[str, Tensor]]:
    """Returns ``sensor_param`` with the matrices of cameras that are where they should be."""
    return {
        name: {**of_camera, **pose_params(cameras[name], specified_pose(cameras[name]))}
        for name, of_camera in params.items()
    }
