"""PrepareGroceries: two objects out of the open fridge, one from the counter into it (S G.2)."""

from __future__ import annotations

from hab_tasks.constants import PREPARE_GROCERIES_HORIZON_STEPS
from hab_tasks.skills.navigate import NAVIGATE
from hab_tasks.skills.pick import PICK
from hab_tasks.skills.place import PLACE
from hab_tasks.tasks.base import Condition, Part, Task
from hab_tasks.tasks.task_env import TaskEnv

OBJECTS = 3


def _moving(number: int) -> tuple[Part, ...]:
    """Returns the skills that move one object."""
    return (
        Part(skill=NAVIGATE, object=number, to="start"),
        Part(skill=PICK, object=number),
        Part(skill=NAVIGATE, object=number, to="goal"),
        Part(skill=PLACE, object=number),
    )


PREPARE_GROCERIES = Task(
    name="prepare_groceries",
    horizon_steps=PREPARE_GROCERIES_HORIZON_STEPS,
    objects=OBJECTS,
    parts=tuple(part for number in range(OBJECTS) for part in _moving(number)),
    stages={
        "pick_fridge_1": Condition(held=(0,)),
        "place_counter": Condition(placed=(0,)),
        "pick_fridge_2": Condition(held=(1,), placed=(0,)),
        "place_table": Condition(placed=(0, 1)),
        "pick_counter": Condition(held=(2,), placed=(0, 1)),
        "place_fridge": Condition(placed=(0, 1, 2)),
    },
    goal=Condition(placed=(0, 1, 2)),
)


class HabPrepareGroceriesEnv(TaskEnv):
    """Move two objects from the fridge to counter and table, and one from the counter into it.

    **Start**: three objects to be moved among 27 others on the open receptacles and in the fridge;
    fridge and drawer open; the robot anywhere on the free floor, turned anyhow (S G.1).

    **Observation** (``state_dict``: ``agent`` and ``extra``; ``state`` is their concatenation):

    ====================  ===========  =====  ======  ==============================================
    entry                 group        shape  unit    meaning
    ====================  ===========  =====  ======  ==============================================
    arm_qpos              agent        7      rad     arm joints, shoulder to wrist
    ee_position           agent        3      m       end-effector in the base frame
    ee_rotation           agent        6      1       x, then y axis of the hand in the base frame
    is_holding            agent        1      0 or 1  whether anything is in the hand
    rest_from_ee          agent        3      m       from the hand to its rest position, base frame
    targets_in_base       extra        18     m       start and goal of each object, base frame
    head, arm             sensor_data  128²   0..1    depth, 1 at 10 m; uint8 with ``rgb``
    ====================  ===========  =====  ======  ==============================================

    **Action**: ``ee_base`` 3 + 1 + 2; ``joint_delta_base``, ``joint_target_base`` and
    ``joint_state_base`` 7 + 1 + 2; ``joint_target_pose`` and ``joint_state_pose`` 7 + 1 + 3
    (`hab_tasks.robots.control`).

    **Reward** (terms in ``info["reward_terms"]``, named ``skill/term``): that of the skill being
    done, in the order navigate, pick, navigate, place for each object (S H.3).

    **Stages**: ``pick_fridge_1``, ``place_counter``, ``pick_fridge_2``, ``place_table``,
    ``pick_counter``, ``place_fridge``, in this order (S G.2).

    **Success**: all three objects within 0.15 m of their goals and let go.

    **Failure**: none; no limit on forces.

    **Horizon**: 4,000 steps. **Versions**: v1, first.
    """

    task = PREPARE_GROCERIES
