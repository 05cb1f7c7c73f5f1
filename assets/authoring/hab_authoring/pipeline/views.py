"""Depth images of a layout from possible poses of the robot's head camera, without a robot."""

from __future__ import annotations

import numpy as np

from hab_authoring.showroom import Showroom
from hab_tasks.constants import CAMERA_DEPTH_MAX_M, CAMERA_HFOV_RAD, CAMERA_SIZE_PX
from hab_tasks.geometry import Array, Pose7, planar
from hab_tasks.rendering import use_default_shaders
from hab_tasks.robots.cameras import camera_pose
from hab_tasks.robots.fetch import FETCH
from hab_tasks.world.navigation import NavigationMap
from hab_tasks.world.scenes.build import to_sapien
from hab_tasks.world.scenes.layout_geometry import Layout
from hab_tasks.world.scenes.spec import SceneSpec

NEAR_M = 0.01


def base_poses(spec: SceneSpec, count: int, rng: np.random.Generator) -> list[Pose7]:
    """Returns random poses of the robot's base on the free floor of a layout."""
    navigation = NavigationMap.of_layout(Layout.of(spec))
    cells = np.argwhere(navigation.free)
    chosen = navigation.positions(cells[rng.integers(len(cells), size=count)])
    yaws = rng.uniform(-np.pi, np.pi, size=count)
    return [planar(x, y, yaw) for (x, y), yaw in zip(chosen.tolist(), yaws.tolist(), strict=True)]


class HeadCamera(Showroom):
    """Renders one layout after another with the parameters of the robot's head camera."""

    def __init__(self) -> None:
        super().__init__("cpu")
        use_default_shaders()
        self._camera = self.scene.add_camera(
            "head", CAMERA_SIZE_PX, CAMERA_SIZE_PX, CAMERA_HFOV_RAD, NEAR_M, CAMERA_DEPTH_MAX_M
        )
        self._base_from_camera = camera_pose(FETCH.cameras["head"])

    def depth_m(self, world_from_base: Pose7) -> Array:
        """Returns the depth (H, W) [m]; the maximum without a hit."""
        self._camera.entity.set_pose(to_sapien(world_from_base) * self._base_from_camera)
        self.scene.update_render()
        self._camera.take_picture()
        position = self._camera.get_picture("Position")
        depth = -position[..., 2].astype(float)
        return np.where(position[..., 3] < 1.0, depth, CAMERA_DEPTH_MAX_M)
