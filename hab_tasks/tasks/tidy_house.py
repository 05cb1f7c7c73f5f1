"""TidyHouse: five objects go from one open receptacle to another (S G.2)."""

from __future__ import annotations

from hab_tasks.constants import TIDY_HOUSE_HORIZON_STEPS
from hab_tasks.skills.navigate import NAVIGATE
from hab_tasks.skills.pick import PICK
from hab_tasks.skills.place import PLACE
from hab_tasks.tasks.base import Condition, Part, Task
from hab_tasks.tasks.task_env import TaskEnv

OBJECTS = 5


def _moving(number: int) -> tuple[Part, ...]:
    """Returns the skills that move one object."""
    return (
        Part(skill=NAVIGATE, object=number, to="start"),
        Part(skill=PICK, object=number),
        Part(skill=NAVIGATE, object=number, to="goal"),
        Part(skill=PLACE, object=number),
    )


def _stages(number: int) -> dict[str, Condition]:
    """Returns the two interactions with one object; earlier ones must be in place."""
    before = tuple(range(number))
    return {
        f"pick_{number + 1}": Condition(held=(number,), placed=before),
        f"place_{number + 1}": Condition(placed=(*before, number)),
    }


TIDY_HOUSE = Task(
    name="tidy_house",
    horizon_steps=TIDY_HOUSE_HORIZON_STEPS,
    objects=OBJECTS,
    parts=tuple(part for number in range(OBJECTS) for part in _moving(number)),
    stages={n: c for number in range(OBJECTS) for n, c in _stages(number).items()},
    goal=Condition(placed=tuple(range(OBJECTS))),
)


class HabTidyHouseEnv(TaskEnv):
    """Move five objects from where they lie to where they belong.

    **Start**: 30 objects on the open receptacles, five of them to be moved; fridge and drawers
    closed; the robot anywhere on the free floor, turned anyhow (S G.1).

    **Observation** (``state_dict``: ``agent`` and ``extra``; ``state`` is their concatenation):

    ====================  ===========  =====  ======  ==============================================
    entry                 group        shape  unit    meaning
    ====================  ===========  =====  ======  ==============================================
    arm_qpos              agent        7      rad     arm joints, shoulder to wrist
    ee_position           agent        3      m       end-effector in the base frame
    ee_rotation           agent        6      1       x, then y axis of the hand in the base frame
    is_holding            agent        1      0 or 1  whether anything is in the hand
    rest_from_ee          agent        3      m       from the hand to its rest position, base frame
    targets_in_base       extra        30     m       start and goal of each object, base frame
    head, arm             sensor_data  128²   0..1    depth, 1 at 10 m; uint8 with ``rgb``
    ====================  ===========  =====  ======  ==============================================

    **Action**: ``ee_base`` 3 + 1 + 2; ``joint_delta_base``, ``joint_target_base`` and
    ``joint_state_base`` 7 + 1 + 2; ``joint_target_pose`` and ``joint_state_pose`` 7 + 1 + 3
    (`hab_tasks.robots.control`).

    **Reward** (terms in ``info["reward_terms"]``, named ``skill/term``): that of the skill being
    done, in the order navigate, pick, navigate, place for each object (S H.3).

    **Stages**: ``pick_1``, ``place_1``, ... ``place_5``, in this order (S G.2).

    **Success**: all five objects within 0.15 m of their goals and let go.

    **Failure**: none; no limit on forces.

    **Horizon**: 5,000 steps. **Versions**: v1, first.
    """

    task = TIDY_HOUSE
