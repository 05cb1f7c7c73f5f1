"""PhysX settings, which are global to the process.

SAPIEN reads them on creating a body. ManiSkill sets them on building an environment, so a scene
without an environment has the settings of the last one. Without this module, episodes would depend
on earlier environments in the process.
"""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import sapien
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.envs.utils.system.backend import parse_sim_and_render_backend
from mani_skill.utils.structs.types import SimConfig
from sapien import physx

from hab_tasks.constants import CONTROL_HZ, SIM_HZ


def sim_config() -> SimConfig:
    """Returns the settings of environments and placement sandboxes.

    PhysX's persistent contacts (`enable_pcm`) are off: they give a lying can energy, so that it
    rolls half a metre after a touch.
    """
    config = SimConfig(sim_freq=SIM_HZ, control_freq=CONTROL_HZ)
    contacts = dataclasses.replace(config.scene_config, enable_pcm=False)
    return dataclasses.replace(config, scene_config=contacts)


def use_settings(config: SimConfig) -> None:
    """Applies settings to all bodies and scenes created from now on, as ManiSkill does."""
    settings: Any = SimpleNamespace(sim_config=config)
    BaseEnv._set_scene_config(settings)


def bare_scene(renderer: str = "none") -> ManiSkillScene:
    """Returns an empty CPU scene without an environment.

    Args:
        renderer: ManiSkill's name of the render device, or ``none``.
    """
    config = sim_config()
    backend = parse_sim_and_render_backend("physx_cpu", renderer)
    systems: list[Any] = [_new_system(config)]
    if renderer != "none":
        systems.append(sapien.render.RenderSystem(backend.render_device))
    return ManiSkillScene(
        [sapien.Scene(systems)], sim_config=config, device=backend.device, backend=backend
    )


def renew_physics(scene: ManiSkillScene) -> None:
    """Gives a scene of `bare_scene` without a renderer a new simulation; its bodies have left it.

    A new simulation has no contact caches, whatever was in the scene before.
    """
    system: Any = _new_system(scene.sim_config)
    scene.sub_scenes = [sapien.Scene([system])]
    scene.px = system


def _new_system(config: SimConfig) -> physx.PhysxCpuSystem:
    use_settings(config)
    system = physx.PhysxCpuSystem()
    system.timestep = 1.0 / SIM_HZ
    return system
