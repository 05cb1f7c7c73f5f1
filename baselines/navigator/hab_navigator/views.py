"""What the goal network sees: the map around the point to go to."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import grid_sample

from hab_navigator.robot_map import CELL_M, CELLS, Bytes, RobotMap, cells_of

SIDE = 64
"""Width and height of a view in cells."""

WHOLE = 92
"""Width and height of the part of a map from which a view is cut at any angle: 64 times the square
root of 2, and more."""

FACTS = 3
"""Height of the point, whether the hand holds something, and whether the map is mirrored: furniture
has its handles on the same side everywhere."""

CHANNELS = 4 + FACTS
"""Heights, seen, visited, distance from the middle, and the facts."""

TOPS_SCALE = 64.0


class View(NamedTuple):
    """The map around a point, in N views.

    Attributes:
        maps: (N, 2, WHOLE, WHOLE) uint8 heights, and what is known (`RobotMap.tops`, `seen`).
        facts: (N, 2) float32 height of the point [m], and whether the hand holds something.
    """

    maps: Tensor
    facts: Tensor

    @classmethod
    def of(cls, map_: RobotMap, height_m: float, holding: bool) -> View:
        """Returns a view of a map."""
        parts = np.stack([around_point(map_, values) for values in (map_.tops, map_.seen)])
        facts = torch.tensor([[height_m, float(holding)]], dtype=torch.float32)
        return cls(torch.from_numpy(parts)[None], facts)


def around_point(map_: RobotMap, values: Bytes) -> Bytes:
    """Returns the cells (WHOLE, WHOLE) of a map around `middle_m`."""
    padded = np.pad(values, WHOLE // 2)
    x, y = cells_of(map_.point_m)
    return padded[x : x + WHOLE, y : y + WHOLE]


def middle_m(map_: RobotMap) -> NDArray[Any]:
    """Returns the position (2,) of the middle of a view: the low corner of the point's cell."""
    return CELL_M * (cells_of(map_.point_m) - CELLS // 2)


def inputs(view: View, angles_rad: Tensor | None = None, flips: Tensor | None = None) -> Tensor:
    """Returns the input of the network, (N, CHANNELS, SIDE, SIDE).

    Args:
        view: The views.
        angles_rad: (N,) by which the maps are turned about their middle; None for 0.
        flips: (N,) bool, which maps are then mirrored in y; None for none.
    """
    maps = view.maps
    if angles_rad is None:
        first = (WHOLE - SIDE) // 2
        cut = maps[..., first : first + SIDE, first : first + SIDE].float()
    else:
        cut = _turned(maps.float(), angles_rad)
    if flips is not None:
        cut = torch.where(flips[:, None, None, None], cut.flip(-1), cut)
    tops, seen = cut[:, 0], cut[:, 1]
    radius = _radius(cut.device).expand_as(tops)
    layers = (tops / TOPS_SCALE, (seen > 0).float(), (seen > 1).float(), radius)
    mirrored = torch.zeros(len(tops), device=cut.device) if flips is None else flips.float()
    facts = torch.cat((view.facts, mirrored[:, None]), dim=1)
    spread = facts[:, :, None, None].expand(-1, -1, SIDE, SIDE)
    return torch.cat((torch.stack(layers, dim=1), spread), dim=1)


def _turned(maps: Tensor, angles_rad: Tensor) -> Tensor:
    """Returns maps (N, 2, WHOLE, WHOLE) turned by angles (N,), and cut out."""
    steps = torch.arange(SIDE, device=maps.device) - (SIDE - 1) / 2
    x, y = torch.meshgrid(steps, steps, indexing="ij")  # of the view
    cosine, sine = angles_rad.cos()[:, None, None], angles_rad.sin()[:, None, None]
    # A view's cell shows the map's cell turned back by the angle.
    at_x, at_y = cosine * x + sine * y, cosine * y - sine * x
    # grid_sample takes the last axis first, in halves of the width.
    grid = torch.stack((at_y, at_x), dim=-1) / (WHOLE / 2)
    return grid_sample(maps, grid, mode="nearest", align_corners=False)


def _radius(device: torch.device) -> Tensor:
    steps = (torch.arange(SIDE, device=device) - (SIDE - 1) / 2) / (SIDE / 2)
    return (steps[:, None].square() + steps[None].square()).sqrt()
