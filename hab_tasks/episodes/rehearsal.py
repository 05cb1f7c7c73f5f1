"""What becomes of a held object that the robot lets go, standing still: played, not computed."""

from __future__ import annotations

import numpy as np
import torch

from hab_tasks.constants import CONTROL_HZ, PLACE_RADIUS_M, SIM_HZ, SKILL_HORIZON_STEPS
from hab_tasks.episodes.schema import RobotStart
from hab_tasks.episodes.workbench import Workbench
from hab_tasks.geometry import Array
from hab_tasks.robots.follow_grasp import make_grasp

GOAL_MARGIN_M = 0.03
"""A fall never ends twice in the same place, to the centimetre: it has to miss by this much."""

PHYSICS_STEPS = SIM_HZ // CONTROL_HZ


def falls_to(bench: Workbench, robot: RobotStart, held: str, goal_com_m: Array) -> bool:
    """Whether a held object that is let go gets to its goal before it comes to rest.

    The robot opens its hand in the first action, as in an episode, and stands still. The object is
    where it starts; it, and what it meets, do not stay there.

    Args:
        bench: The start state.
        robot: Where the robot starts.
        held: The object in its hand.
        goal_com_m: Where the object's centre of mass is to be (3,).
    """
    agent = bench.stand_robot(robot.base, np.array(robot.arm_qpos_rad))
    names, movable = list(bench.handles.movable), list(bench.handles.movable.values())
    grasp = make_grasp(agent.scene, agent.ee_link, movable, [], "objects")
    grasp.attach(0, names.index(held))
    idle = agent.controller.idle_action(torch.tensor([False]))
    near = False
    for _ in range(SKILL_HORIZON_STEPS):
        agent.controller.set_action(idle)
        grasp.command(agent.controller.gripper)
        for _ in range(PHYSICS_STEPS):
            grasp.before_simulation_step()
            agent.scene.px.step()
        grasp.after_control_step()
        gap_m = float(np.linalg.norm(bench.com_m(held) - goal_com_m))
        near = gap_m < PLACE_RADIUS_M + GOAL_MARGIN_M
        if near or bench.asleep(held):
            break
    grasp.reset(torch.zeros(1, dtype=torch.long))
    bench.send_robot_away()
    return near
