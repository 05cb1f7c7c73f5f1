"""Friction and damping of doors and drawers: what is let go comes to rest, and stays.

The friction coefficient of PhysX's joints is a share of the load and not a force (measured: 4 holds
a drawer against any pull). Friction here is a drive towards standing still whose force is limited,
which is Coulomb's law; it costs nothing in a step. Damping is the links' own.
"""

from __future__ import annotations

from dataclasses import dataclass

from mani_skill.utils.structs import Articulation

BRAKE = 1e4
"""Damping [N s/m or N m s/rad] of the drive: below its limit, a load moves a joint by less than
1 mm/s or mrad/s."""


@dataclass(frozen=True, kw_only=True)
class JointFriction:
    """How a kind of joint resists.

    Attributes:
        usual: Friction where the URDF states none [N or N m].
        least: Less than this in a URDF is a placeholder, as ReplicaCAD's 0.01 is.
        damping_per_s: Viscous damping: the speed v of a link that is let go decays by
            dv/dt = -damping_per_s * v, friction left aside.
    """

    usual: float
    least: float
    damping_per_s: float

    def of(self, stated: float | None) -> float:
        """Returns the friction [N or N m] of a joint whose URDF states this."""
        return self.usual if stated is None or stated < self.least else stated


SLIDE = JointFriction(usual=4.0, least=2.0, damping_per_s=2.0)
"""Drawers and sliding doors run on rails: 2 to 8 N."""

HINGE = JointFriction(usual=0.8, least=0.3, damping_per_s=2.5)
"""Doors: 0.3 to 1 N m."""


def brake(furniture: Articulation, stated: dict[str, float]) -> None:
    """Gives every joint of a piece of furniture its friction and damping.

    Args:
        furniture: As built.
        stated: Joint name -> friction in its URDF [N or N m].
    """
    for joint in furniture.active_joints:
        kind = SLIDE if joint.type[0] == "prismatic" else HINGE
        joint.set_friction(0.0)
        joint.set_drive_properties(
            0.0, BRAKE, force_limit=kind.of(stated.get(joint.name)), mode="force"
        )
        assert joint.child_link is not None
        for body in joint.child_link._objs:
            body.set_linear_damping(kind.damping_per_s)
            body.set_angular_damping(kind.damping_per_s)
