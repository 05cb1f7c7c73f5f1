"""Simulates the release of a held object while the robot stands still."""

from __future__ import annotations

import numpy as np

from hab_tasks.constants import CONTROL_HZ, PLACE_RADIUS_M, SIM_HZ, SKILL_HORIZON_STEPS
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import RobotStart
from hab_tasks.geometry import Array
from hab_tasks.robots.grasp import SnapGrasp

GOAL_MARGIN_M = 0.03
"""Required margin to the goal, as the end of a fall varies by centimetres."""

PHYSICS_STEPS = SIM_HZ // CONTROL_HZ


def falls_to(sandbox: PlacementSandbox, robot: RobotStart, held: str, goal_com_m: Array) -> bool:
    """Whether a released object reaches its goal before it comes to rest.

    The robot opens its hand in the first action, as in an episode, and stands still. The object
    starts at its start pose; the poses of it and of other objects are not restored.

    Args:
        sandbox: The start state.
        robot: Start pose of the robot.
        held: The held object.
        goal_com_m: Goal position (3,) of the object's centre of mass.
    """
    agent = sandbox.stand_robot(robot.base, np.array(robot.arm_qpos_rad))
    names, movable = list(sandbox.scene_bodies.movable), list(sandbox.scene_bodies.movable.values())
    grasp = SnapGrasp(agent, movable, [], "objects")
    grasp.attach(names.index(held))
    idle = agent.controller.idle_action(holding=False)
    near = False
    for _ in range(SKILL_HORIZON_STEPS):
        agent.controller.set_entries(idle)
        grasp.command(agent.controller.gripper)
        for _ in range(PHYSICS_STEPS):
            grasp.before_physics_step()
            agent.scene.px.step()
        grasp.after_control_step()
        gap_m = float(np.linalg.norm(sandbox.com_m(held) - goal_com_m))
        near = gap_m < PLACE_RADIUS_M + GOAL_MARGIN_M
        if near or sandbox.asleep(held):
            break
    grasp.reset()
    sandbox.send_robot_away()
    return near
