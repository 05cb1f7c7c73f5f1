"""Open cabinet: slide a door of the kitchen's cabinet aside."""

from dataclasses import replace

from hab_tasks.articulations import ArticulationKind, HandleMarker, Rectangle, add_kind
from hab_tasks.engine.skill_env import SkillEnv
from hab_tasks.skills.open_drawer import OPEN_DRAWER

BEFORE = Rectangle(x_m=(0.6, 0.9), y_m=(-0.4, 0.4))
CABINET = ArticulationKind(
    name="cabinet",
    marker="cabinet_left_door",
    open_at=None,
    open_share=0.4,
    closed_at=0.05,
    **dict.fromkeys(("opening_region", "closing_region"), BEFORE),
)
PLACE = {"template": "cabinet", "link": "left_door", "offset_m": (-0.3, 0.0, 0.03)}
add_kind(CABINET, HandleMarker(name=CABINET.marker, **PLACE))


def success(s, m, g, c):
    """Door open, hand at rest, (N,) bool."""
    return CABINET.is_open(m.joint, m.joint_share) & (m.ee_to_rest_m < c.rest_radius_m)


class OpenCabinetEnv(SkillEnv):
    """Slide a door of the cabinet aside; reward and measures are those of Open drawer."""

    skill = replace(
        OPEN_DRAWER,
        name="open_cabinet",
        instruction="Open the cabinet.",
        requirements=replace(OPEN_DRAWER.requirements, articulations=(CABINET,)),
        success=success,
    )
