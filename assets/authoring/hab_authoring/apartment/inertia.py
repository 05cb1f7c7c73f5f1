"""Mass properties of a link made of boxes of one density."""

from dataclasses import dataclass

import numpy as np

from hab_authoring.apartment.model import Array, Box


@dataclass(frozen=True)
class MassProperties:
    """Centre of mass, and the inertia tensor about it."""

    center: Array  # (3,) m
    tensor: Array  # (3, 3) kg m^2


def of_boxes(boxes: list[Box], mass_kg: float) -> MassProperties:
    """Spread the mass over the boxes by volume."""
    volumes = np.array([float(np.prod(box.size)) for box in boxes])
    masses = mass_kg * volumes / volumes.sum()
    centers = np.array([box.center for box in boxes])
    center = masses @ centers / mass_kg
    tensor = np.zeros((3, 3))
    for mass, box in zip(masses, boxes, strict=True):
        squares = np.asarray(box.size) ** 2
        own = mass / 12 * np.diag(squares.sum() - squares)
        arm = np.asarray(box.center) - center
        tensor += own + mass * (float(arm @ arm) * np.eye(3) - np.outer(arm, arm))
    return MassProperties(center, tensor)
