"""Lamps of a layout, replaced when the active layout changes."""

from __future__ import annotations

import sapien
from mani_skill.envs.scene import ManiSkillScene

from hab_tasks.world.scenes.spec import PointLight

MAX_LIGHTS = 12


class LayoutLights:
    """Lighting of the scene: ambient light, a soft sky, and the layout's lamps."""

    def __init__(self, scene: ManiSkillScene) -> None:
        """Adds the lights shared by all layouts."""
        scene.set_ambient_light([0.35, 0.35, 0.35])
        scene.add_directional_light([0.3, 0.5, -1.0], [0.9, 0.9, 0.85])
        self._scene = scene
        self._lamps: list[sapien.Entity] = []
        self._shown: tuple[PointLight, ...] = ()

    def show(self, lights: tuple[PointLight, ...]) -> None:
        """Replaces the lamps by these, at most `MAX_LIGHTS`."""
        if lights == self._shown:
            return
        for lamp in self._lamps:
            lamp.remove_from_scene()
        self._lamps = [
            self._scene.add_point_light(list(light.position_m), list(light.color)).entity
            for light in lights[:MAX_LIGHTS]
        ]
        self._shown = lights
