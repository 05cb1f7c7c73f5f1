"""Rendered layouts without a robot: any view, and top views without the ceiling."""

from __future__ import annotations

import numpy as np
import sapien
import torch
from numpy.typing import NDArray

from hab_tasks.geometry import Array
from hab_tasks.rendering import use_default_shaders
from hab_tasks.world.scenes.build import LayoutLights
from hab_tasks.world.scenes.physics import bare_scene
from hab_tasks.world.scenes.pool import BodyPool
from hab_tasks.world.scenes.spec import SceneSpec

EYE_M = 40.0
"""Camera height, large enough that walls do not occlude their surroundings."""

CUT_M, UNCUT_M = 2.45, 3.0
"""Clipping height: below the ceiling, or above walls that are boxes without a ceiling."""

BELOW_M = 1.0


class Showroom:
    """Renders one layout after another.

    Args:
        backend: ManiSkill's name of the render device.

    Attributes:
        scene: SAPIEN's scene.
    """

    def __init__(self, backend: str) -> None:
        scene = bare_scene(backend)
        self.scene = scene.sub_scenes[0]
        self._pool = BodyPool(scene, {})
        self._lights = LayoutLights(scene)

    def show(self, spec: SceneSpec) -> None:
        """Activates a layout, doors and drawers closed."""
        scene_bodies = self._pool.show(spec, ())
        self._lights.show(spec.lights)
        for furniture in scene_bodies.articulations.values():
            # This also updates the link poses of new furniture in the engine.
            furniture.set_qpos(torch.zeros_like(furniture.get_qpos()))

    def top_view(
        self, spec: SceneSpec, low_m: Array, high_m: Array, pixels_per_m: float
    ) -> NDArray[np.uint8]:
        """Returns an image (H, W, 3) of a layout from above, y up.

        Args:
            spec: The layout.
            low_m: Lower corner (2,) of the room, which fills the image.
            high_m: Upper corner (2,).
            pixels_per_m: Scale at the height of the cut.
        """
        self.show(spec)
        width, height = (round(float(pixels_per_m * side)) for side in high_m - low_m)
        camera = sapien.render.RenderCameraComponent(width, height)
        near_m = EYE_M - (UNCUT_M if spec.stage.visual_file is None else CUT_M)
        focal = pixels_per_m * near_m
        camera.set_perspective_parameters(
            near_m, EYE_M + BELOW_M, focal, focal, width / 2, height / 2, 0.0
        )
        return photograph(self.scene, camera, _looking_down((low_m + high_m) / 2))[0]


def photograph(
    scene: sapien.Scene, camera: sapien.render.RenderCameraComponent, pose: sapien.Pose
) -> tuple[NDArray[np.uint8], Array]:
    """Returns what a new camera sees of a scene from a pose, (H, W, 3), and its eye_from_world.

    That is (3, 4), x right, y down, z ahead.
    """
    use_default_shaders()
    entity = sapien.Entity()
    entity.add_component(camera)
    entity.pose = pose
    scene.add_entity(entity)
    scene.update_render()
    camera.take_picture()
    color = camera.get_picture("Color")[..., :3]
    eye_from_world = np.array(camera.get_extrinsic_matrix(), dtype=float)[:3]
    scene.remove_entity(entity)
    return (255 * color.clip(0, 1)).round().astype(np.uint8), eye_from_world


def _looking_down(middle_m: Array) -> sapien.Pose:
    """Returns a camera pose above a point (2,): SAPIEN's look along x, with y left and z up."""
    world_from_eye = np.eye(4)
    world_from_eye[:3, :3] = np.array([(0, 0, -1), (-1, 0, 0), (0, 1, 0)]).T
    world_from_eye[:3, 3] = (*middle_m, EYE_M)
    return sapien.Pose(world_from_eye)
