"""PhysX settings, which are global to the process.

SAPIEN reads them on creating a body. ManiSkill sets them on building an environment, so a scene
without an environment has the settings of the last one. Without this module, episodes would depend
on earlier environments in the process.

Collision groups are bits of SAPIEN's group words. Two shapes collide if ``a[0] & b[1]`` or
``a[1] & b[0]``, unless they share an ignore bit in ``[2]`` and the number in ``[3]``. Most contacts
in a furnished flat are irrelevant (a cupboard on the floor, a plate on a shelf, both at rest);
passive bodies do not generate them.

The friction coefficient of PhysX's joints is a share of the load and not a force (measured: 4 holds
a drawer against any pull). Friction of doors and drawers, with which released ones come to rest and
stay, is a force-limited velocity drive to zero instead, which is Coulomb's law and does not slow
down a step. Damping is that of the links.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import sapien
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.structs import Articulation
from mani_skill.utils.structs.types import SimConfig
from sapien import physx

from hab_tasks.constants import CONTROL_HZ, SIM_HZ
from hab_tasks.simulator import parse_sim_and_render_backend, sapien_object, use_settings


def sim_config() -> SimConfig:
    """Returns the settings of environments and placement sandboxes.

    PhysX's persistent contacts (`enable_pcm`) are off: they give a lying can energy, so that it
    rolls half a metre after a touch.
    """
    config = SimConfig(sim_freq=SIM_HZ, control_freq=CONTROL_HZ)
    contacts = dataclasses.replace(config.scene_config, enable_pcm=False)
    return dataclasses.replace(config, scene_config=contacts)


def bare_scene(renderer: str = "none") -> ManiSkillScene:
    """Returns an empty CPU scene without an environment; `renderer` is ManiSkill's name or none."""
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


Groups = tuple[int, int]

ROBOT: Groups = (0b0001, 0b1101)
HAND: Groups = (0b10000, 0b1101)
"""The robot's hand: as the robot, and it passes through a held door or drawer."""

STATIC: Groups = (0b0011, 0b0011)
MOVING: Groups = (0b0011, 0b1111)
"""Awake objects: collide with everything."""

HELD: Groups = (0b0010, 0b1110)
"""Held objects: collide with everything except the robot."""

FRONT: Groups = (0b0011, 0b0111)
"""Doors and drawers: collide with all but sleeping objects, which they wake on approach."""

HELD_FRONT: Groups = (0b0010, 0b0111)
"""A door or drawer whose handle is held: as `FRONT`, but it does not collide with the hand."""

PASSIVE: Groups = (0b0100, 0b0000)
"""Furniture bodies: collide with the robot and moving bodies, not with each other."""

FROZEN: Groups = (0b1000, 0b0000)
"""Sleeping objects: collide with the robot and moving objects."""

FLOOR_BIT = 1 << 31
"""Ignore bit shared by the robot's base and flat bodies on the floor."""

FURNITURE_BIT = 1 << 29
"""Ignore bit shared by the links of one piece of furniture, which joint limits keep apart."""


def set_groups(body: Any, groups: Groups) -> None:
    """Sets the groups of all shapes of a body; ignore bits are kept."""
    for shape in body.collision_shapes:
        now = shape.get_collision_groups()
        if (now[0], now[1]) != groups:
            now[0], now[1] = groups
            shape.set_collision_groups(now)


BRAKE = 1e4
"""Damping [N s/m or N m s/rad] of the drive: below its limit, a load moves a joint by less than
1 mm/s or mrad/s."""


@dataclass(frozen=True, kw_only=True)
class JointFriction:
    """Friction and damping of a joint type.

    Attributes:
        usual: Default friction [N or N m].
        least: Values in a URDF below this are placeholders, e.g. ReplicaCAD's 0.01.
        damping_per_s: Viscous damping: the speed v of a released link decays by
            dv/dt = -damping_per_s * v, without friction.
    """

    usual: float
    least: float
    damping_per_s: float

    def of(self, stated: float | None) -> float:
        """Returns the friction [N or N m] of a joint with a stated value in its URDF."""
        return self.usual if stated is None or stated < self.least else stated


SLIDE = JointFriction(usual=4.0, least=2.0, damping_per_s=2.0)
"""Drawers and sliding doors run on rails: 2 to 8 N."""

HINGE = JointFriction(usual=0.8, least=0.3, damping_per_s=2.5)
"""Doors: 0.3 to 1 N m."""


def brake(furniture: Articulation, stated: dict[str, float]) -> None:
    """Sets friction and damping of every joint; `stated`: joint name -> friction [N or N m]."""
    for joint in furniture.active_joints:
        kind = SLIDE if joint.type[0] == "prismatic" else HINGE
        joint.set_friction(0.0)
        joint.set_drive_properties(
            0.0, BRAKE, force_limit=kind.of(stated.get(joint.name)), mode="force"
        )
        assert joint.child_link is not None
        body = sapien_object(joint.child_link)
        body.set_linear_damping(kind.damping_per_s)
        body.set_angular_damping(kind.damping_per_s)
