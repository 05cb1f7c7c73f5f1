"""Reads lighting_config files: the lamps of layouts."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from hab_tasks.geometry import WORLD_FROM_HABITAT, apply
from hab_tasks.world.scenes.fields import read_fields
from hab_tasks.world.scenes.spec import PointLight


@lru_cache(maxsize=64)
def read_lamps(file: Path) -> tuple[PointLight, ...]:
    """Returns the point lights that shine.

    Raises:
        DatasetError: The file is damaged.
    """
    config = read_fields(file).part("lights", optional=True)
    lamps = []
    for key in config.values:
        lamp = config.part(key)
        intensity = lamp.number("intensity", 1.0)
        # ReplicaCAD takes light away with negative lamps; the renderer here has no such thing.
        if lamp.text("type", "point") != "point" or intensity <= 0:
            continue
        x, y, z = map(float, apply(WORLD_FROM_HABITAT, np.array(lamp.vector("position"))))
        red, green, blue = lamp.vector("color", (1.0, 1.0, 1.0))
        color = (intensity * red, intensity * green, intensity * blue)
        lamps.append(PointLight(position_m=(x, y, z), color=color))
    return tuple(lamps)
