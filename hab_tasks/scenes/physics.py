"""The settings of PhysX, which belong to the process and not to a scene.

SAPIEN reads them whenever a body is made. ManiSkill sets them when it builds an environment, so a
scene without an environment has whatever was built last: without this module episodes would depend
on what else their process has done.
"""

from __future__ import annotations

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
    """Returns the settings of every environment and of all that prepares episodes for one."""
    return SimConfig(sim_freq=SIM_HZ, control_freq=CONTROL_HZ)


def use_settings(config: SimConfig) -> None:
    """Does what ManiSkill does for an environment: bodies and scenes made from now on are alike."""
    settings: Any = SimpleNamespace(sim_config=config)
    BaseEnv._set_scene_config(settings)


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
