"""Friction and damping of doors and drawers, so that released ones come to rest and stay.

The friction coefficient of PhysX's joints is a share of the load and not a force (measured: 4 holds
a drawer against any pull). Friction here is a force-limited velocity drive to zero, which is
Coulomb's law and does not slow down a step. Damping is that of the links.
"""

from __future__ import annotations

from dataclasses import dataclass

from mani_skill.utils.structs import Articulation

from hab_tasks.simulator import sapien_object

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
    """Sets friction and damping of every joint of a piece of furniture.

    Args:
        furniture: The built furniture.
        stated: Joint name -> friction in its URDF [N or N m].
    """
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
