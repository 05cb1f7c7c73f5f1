"""SetTable: the bowl from the drawer to the table, the apple from the fridge into it (S G.2)."""

from __future__ import annotations

from hab_tasks.constants import SET_TABLE_HORIZON_STEPS
from hab_tasks.fronts import DRAWER, FRIDGE
from hab_tasks.skills.close_drawer import CLOSE_DRAWER
from hab_tasks.skills.close_fridge import CLOSE_FRIDGE
from hab_tasks.skills.navigate import NAVIGATE
from hab_tasks.skills.open_drawer import OPEN_DRAWER
from hab_tasks.skills.open_fridge import OPEN_FRIDGE
from hab_tasks.skills.pick import PICK
from hab_tasks.skills.place import PLACE
from hab_tasks.tasks.base import Condition, Part, Task
from hab_tasks.tasks.task_env import TaskEnv

BOWL, APPLE = 0, 1
IN_DRAWER, IN_FRIDGE = 0, 1

SET_TABLE = Task(
    name="set_table",
    horizon_steps=SET_TABLE_HORIZON_STEPS,
    objects=2,
    fronts=(DRAWER, FRIDGE),
    parts=(
        Part(skill=NAVIGATE, object=BOWL, front=IN_DRAWER, to="handle"),
        Part(skill=OPEN_DRAWER, object=BOWL, front=IN_DRAWER),
        Part(skill=NAVIGATE, object=BOWL, front=IN_DRAWER, to="start"),
        Part(skill=PICK, object=BOWL, front=IN_DRAWER),
        Part(skill=NAVIGATE, object=BOWL, front=IN_DRAWER, to="goal"),
        Part(skill=PLACE, object=BOWL, front=IN_DRAWER),
        Part(skill=NAVIGATE, object=BOWL, front=IN_DRAWER, to="handle"),
        Part(skill=CLOSE_DRAWER, object=BOWL, front=IN_DRAWER),
        Part(skill=NAVIGATE, object=APPLE, front=IN_FRIDGE, to="handle"),
        Part(skill=OPEN_FRIDGE, object=APPLE, front=IN_FRIDGE),
        Part(skill=NAVIGATE, object=APPLE, front=IN_FRIDGE, to="start"),
        Part(skill=PICK, object=APPLE, front=IN_FRIDGE),
        Part(skill=NAVIGATE, object=APPLE, front=IN_FRIDGE, to="goal"),
        Part(skill=PLACE, object=APPLE, front=IN_FRIDGE),
        Part(skill=NAVIGATE, object=APPLE, front=IN_FRIDGE, to="handle"),
        Part(skill=CLOSE_FRIDGE, object=APPLE, front=IN_FRIDGE),
    ),
    stages={
        "open_drawer": Condition(opened=(IN_DRAWER,)),
        "pick_bowl": Condition(held=(BOWL,)),
        "place_bowl": Condition(placed=(BOWL,)),
        "close_drawer": Condition(placed=(BOWL,), closed=(IN_DRAWER,)),
        "open_fridge": Condition(placed=(BOWL,), opened=(IN_FRIDGE,), closed=(IN_DRAWER,)),
        "pick_apple": Condition(held=(APPLE,), placed=(BOWL,), closed=(IN_DRAWER,)),
        "place_apple": Condition(placed=(BOWL, APPLE), closed=(IN_DRAWER,)),
        "close_fridge": Condition(placed=(BOWL, APPLE), closed=(IN_DRAWER, IN_FRIDGE)),
    },
    goal=Condition(placed=(BOWL, APPLE), closed=(IN_DRAWER, IN_FRIDGE)),
)


class HabSetTableEnv(TaskEnv):
    """Put the bowl from a closed drawer on the table, and the apple from the fridge into it.

    **Start**: bowl and apple among 27 other objects on the open receptacles and in the fridge;
    fridge and drawers closed; the robot anywhere on the free floor, turned anyhow (S G.1). What is
    behind a closed door or in a closed drawer cannot be grasped.

    **Observation** (``state_dict``: ``agent`` and ``extra``; ``state`` is their concatenation):

    ====================  ===========  =====  ======  ==============================================
    entry                 group        shape  unit    meaning
    ====================  ===========  =====  ======  ==============================================
    arm_qpos              agent        7      rad     arm joints, shoulder to wrist
    ee_position           agent        3      m       end-effector in the base frame
    ee_rotation           agent        6      1       x, then y axis of the hand in the base frame
    is_holding            agent        1      0 or 1  whether anything is in the hand
    rest_from_ee          agent        3      m       from the hand to its rest position, base frame
    targets_in_base       extra        12     m       start and goal of each object, base frame
    head, arm             sensor_data  128²   0..1    depth, 1 at 10 m; uint8 with ``rgb``
    ====================  ===========  =====  ======  ==============================================

    **Action**: ``ee_base`` 3 + 1 + 2; ``joint_delta_base``, ``joint_target_base`` and
    ``joint_state_base`` 7 + 1 + 2; ``joint_target_pose`` and ``joint_state_pose`` 7 + 1 + 3
    (`hab_tasks.robots.control`).

    **Reward** (terms in ``info["reward_terms"]``, named ``skill/term``): that of the skill being
    done: open drawer, pick, place, close drawer, open fridge, pick, place, close fridge, each after
    navigate, and navigate before each place (S H.3).

    **Stages**: ``open_drawer``, ``pick_bowl``, ``place_bowl``, ``close_drawer``, ``open_fridge``,
    ``pick_apple``, ``place_apple``, ``close_fridge``, in this order (S G.2).

    **Success**: bowl and apple within 0.15 m of their goals and let go, drawer and fridge closed.

    **Failure**: none; no limit on forces.

    **Horizon**: 4,500 steps. **Versions**: v1, first.
    """

    task = SET_TABLE
