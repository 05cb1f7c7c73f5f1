"""Map of the cameras' views: occupied voxels, and hidden ones behind them (S App. D, SPA)."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hab_spa.sensing.cloud import DepthView, surface_points_m
from hab_spa.sensing.fitted_box import FittedBox
from hab_spa.sensing.voxels import VoxelConfig, VoxelMap
from hab_spa.shapes import Array


@dataclass(frozen=True, kw_only=True)
class MapConfig:
    """Parameters of the map.

    Attributes:
        spacing_m: Spacing of interpolated surface points.
        slope: See `hab_spa.sensing.cloud.surface_points_m`.
        behind_m: Depth of hidden space behind a surface, unless another view shows it free.
        views: Number of views that are stored.
        keep_m: Voxels and views farther than this from the camera are removed.
        voxels: Parameters of surface voxels.
        hidden: Parameters of hidden voxels.
    """

    spacing_m: float = 0.009
    slope: float = 5.0
    behind_m: float = 0.3
    views: int = 16
    keep_m: float = 2.6
    voxels: VoxelConfig = field(default_factory=VoxelConfig)
    hidden: VoxelConfig = field(default_factory=lambda: VoxelConfig(size_m=0.03, through_m=0.03))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Look:
    """A stored view.

    Attributes:
        view: The image.
        world: (H, W) mask of the mapped pixels.
        centres_m: (V, 3) centres of their coarse voxels.
    """

    view: DepthView
    world: NDArray[np.bool_]
    centres_m: Array


class SeenMap:
    """A map accumulated over views."""

    def __init__(self, config: MapConfig | None = None) -> None:
        """Creates an empty map."""
        self.config = config or MapConfig()
        self._voxels = VoxelMap(self.config.voxels)
        self._felt = VoxelMap(self.config.voxels)
        self._looks: deque[_Look] = deque(maxlen=self.config.views)

    def add(self, view: DepthView, world: NDArray[np.bool_]) -> None:
        """Adds the masked pixels (H, W) of a view; the view also clears voxels."""
        config = self.config
        self._forget_beyond(view.world_from_camera[:3, 3])
        self._voxels.carve(view)
        points_m = surface_points_m(view, world, config.spacing_m, config.slope)
        here = VoxelMap(config.hidden)
        here.add(points_m)
        self._voxels.add(points_m)
        self._looks.append(_Look(view=view, world=world, centres_m=here.centres_m()))

    def add_contacts(self, points_m: Array) -> None:
        """Adds felt obstacle points (K, 3); views that see through them clear them."""
        self._felt.add(points_m)

    def remove(self, box: FittedBox, margin_m: float) -> None:
        """Removes everything within `margin_m` of a box, whose object has been moved."""
        self._voxels.clear(box.contains(self._voxels.centres_m(), margin_m))
        for number, look in enumerate(self._looks):
            gone = look.world.copy()
            gone[look.world] = box.contains(look.view.points_m[look.world], margin_m)
            self._looks[number] = replace(
                look,
                world=look.world & ~gone,
                centres_m=look.centres_m[~box.contains(look.centres_m, margin_m)],
            )

    def mark(self) -> None:
        """Marks the current voxels as known, for `new_m`."""
        self._voxels.mark()

    def new_m(self, centre_m: Array, reach_m: float) -> Array:
        """Returns the voxels of `occupied_m` added since `mark`."""
        return _near(self._voxels.new_m(), centre_m, reach_m)

    def occupied_m(self, centre_m: Array, reach_m: float) -> Array:
        """Returns the centres (V, 3) of the surface voxels near a point (3,)."""
        return _near(self._voxels.centres_m(), centre_m, reach_m)

    def felt_m(self) -> Array:
        """Returns the centres (V, 3) of the felt voxels that no view shows as free."""
        for look in self._looks if len(self._felt) else ():
            self._felt.carve(look.view)
        return self._felt.centres_m()

    def hidden_m(self, centre_m: Array, reach_m: float) -> Array:
        """Returns the centres (V, 3) of the hidden voxels near a point (3,)."""
        hidden, size_m = VoxelMap(self.config.hidden), self.config.hidden.size_m
        depths_m = np.arange(1.5 * size_m, self.config.behind_m, size_m)[:, None, None]
        behind_m = [np.zeros((0, 3))]
        for look in self._looks:
            surface_m = _near(look.centres_m, centre_m, reach_m)
            rays = surface_m - look.view.world_from_camera[:3, 3]
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
            behind_m.append((surface_m + depths_m * rays).reshape(-1, 3))
        hidden.add(np.concatenate(behind_m))
        for look in self._looks:
            hidden.carve(look.view)
        return hidden.centres_m()

    def points_m(self, centre_m: Array, reach_m: float, spacing_m: float, slope: float) -> Array:
        """Returns surface points (K, 3) near a point (3,) from the stored views."""
        found = [np.zeros((0, 3))]
        for look in self._looks:
            near = look.world & (((look.view.points_m - centre_m) ** 2).sum(axis=-1) < reach_m**2)
            if near.any():
                found.append(surface_points_m(look.view, near, spacing_m, slope))
        return np.concatenate(found)

    def _forget_beyond(self, camera_m: Array) -> None:
        """Removes voxels and views far from the camera (3,), beyond the arm's reach."""
        keep_m = self.config.keep_m
        for voxels in (self._voxels, self._felt):
            voxels.crop(camera_m, keep_m)
        for look in [
            look
            for look in self._looks
            if np.linalg.norm(look.view.world_from_camera[:3, 3] - camera_m) >= keep_m
        ]:
            self._looks.remove(look)


def _near(points_m: Array, centre_m: Array, reach_m: float) -> Array:
    return points_m[((points_m - centre_m) ** 2).sum(axis=1) < reach_m**2]
