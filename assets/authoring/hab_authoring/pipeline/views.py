"""Depth images of a layout from possible poses of the robot's head camera, without a robot."""

from __future__ import annotations

import numpy as np
import torch

from hab_tasks.constants import CAMERA_DEPTH_MAX_M, CAMERA_HFOV_RAD, CAMERA_SIZE_PX
from hab_tasks.geometry import Array, Pose7, planar
from hab_tasks.navigation import NavigationMap
from hab_tasks.rendering import use_default_shaders
from hab_tasks.robots.cameras import PLACES
from hab_tasks.scenes.build import to_sapien
from hab_tasks.scenes.layout_geometry import Layout
from hab_tasks.scenes.lights import LayoutLights
from hab_tasks.scenes.physics import bare_scene
from hab_tasks.scenes.pool import BodyPool
from hab_tasks.scenes.spec import SceneSpec

NEAR_M = 0.01


def base_poses(spec: SceneSpec, count: int, rng: np.random.Generator) -> list[Pose7]:
    """Returns random poses of the robot's base on the free floor of a layout."""
    navigation = NavigationMap.of_layout(Layout.of(spec))
    cells = np.argwhere(navigation.free)
    chosen = navigation.positions(cells[rng.integers(len(cells), size=count)])
    yaws = rng.uniform(-np.pi, np.pi, size=count)
    return [planar(x, y, yaw) for (x, y), yaw in zip(chosen.tolist(), yaws.tolist(), strict=True)]


class HeadCamera:
    """Renders one layout after another with the parameters of the robot's head camera.

    Args:
        size_px: Width and height of the images.
    """

    def __init__(self, size_px: int = CAMERA_SIZE_PX) -> None:
        self._scene = bare_scene("cpu")
        self._pool = BodyPool(self._scene, {})
        self._lights = LayoutLights(self._scene)
        self._inner = self._scene.sub_scenes[0]
        use_default_shaders()
        self._camera = self._inner.add_camera(
            "head", size_px, size_px, CAMERA_HFOV_RAD, NEAR_M, CAMERA_DEPTH_MAX_M
        )
        self._base_from_camera = PLACES["head"].pose()

    def show(self, spec: SceneSpec) -> None:
        """Activates a layout, doors and drawers closed."""
        scene_bodies = self._pool.show(spec, ())
        self._lights.show(spec.lights)
        for furniture in scene_bodies.articulations.values():
            # This also updates the link poses of new furniture in the engine.
            furniture.set_qpos(torch.zeros_like(furniture.get_qpos()))

    def depth_m(self, world_from_base: Pose7) -> Array:
        """Returns the depth (H, W) [m]; the maximum without a hit."""
        position = self._picture(world_from_base, "Position")
        depth = -position[..., 2].astype(float)
        return np.where(position[..., 3] < 1.0, depth, CAMERA_DEPTH_MAX_M)

    def color(self, world_from_base: Pose7) -> Array:
        """Returns a colour image (H, W, 3) in [0, 1]."""
        return self._picture(world_from_base, "Color")[..., :3].clip(0.0, 1.0)

    def _picture(self, world_from_base: Pose7, name: str) -> Array:
        self._camera.entity.set_pose(to_sapien(world_from_base) * self._base_from_camera)
        self._inner.update_render()
        self._camera.take_picture()
        return self._camera.get_picture(name)
