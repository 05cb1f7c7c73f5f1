"""The settings of PhysX, which belong to the process and not to a scene.

SAPIEN reads them whenever a body is made. ManiSkill sets them when it builds an environment, so a
scene without an environment has whatever was built last: without this module episodes would depend
on what else their process has done.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import sapien
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.envs.utils.system.backend import parse_sim_and_render_backend
from mani_skill.utils.structs.types import SimConfig
from sapien import physx

from hab_tasks.constants import CONTROL_HZ, SIM_HZ


def sim_config() -> SimConfig:
    """Returns the settings of every environment and of all that prepares episodes for one."""
    return SimConfig(sim_freq=SIM_HZ, control_freq=CONTROL_HZ)


def use_settings(config: SimConfig) -> None:
    """Sets how bodies made from now on touch, rest and are solved, and the scenes' solver."""
    scene = config.scene_config
    gravity: Any = np.asarray(scene.gravity)
    physx.set_shape_config(contact_offset=scene.contact_offset, rest_offset=scene.rest_offset)
    physx.set_body_config(
        solver_position_iterations=scene.solver_position_iterations,
        solver_velocity_iterations=scene.solver_velocity_iterations,
        sleep_threshold=scene.sleep_threshold,
    )
    physx.set_scene_config(
        gravity=gravity,
        bounce_threshold=scene.bounce_threshold,
        enable_pcm=scene.enable_pcm,
        enable_tgs=scene.enable_tgs,
        enable_ccd=scene.enable_ccd,
        enable_enhanced_determinism=scene.enable_enhanced_determinism,
        enable_friction_every_iteration=scene.enable_friction_every_iteration,
        cpu_workers=scene.cpu_workers,
    )
    physx.set_default_material(**config.default_materials_config.dict())


def bare_scene(renderer: str = "none") -> ManiSkillScene:
    """Returns an empty scene on the CPU, without an environment around it.

    Args:
        renderer: ManiSkill's name of the device that draws, or ``none``.
    """
    config = sim_config()
    use_settings(config)
    backend = parse_sim_and_render_backend("physx_cpu", renderer)
    systems: list[Any] = [physx.PhysxCpuSystem()]
    systems[0].timestep = 1.0 / SIM_HZ
    if renderer != "none":
        systems.append(sapien.render.RenderSystem(backend.render_device))
    return ManiSkillScene(
        [sapien.Scene(systems)], sim_config=config, device=backend.device, backend=backend
    )
