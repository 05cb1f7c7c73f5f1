"""The hand of a robot: the snap grasp (S E.3), or fingers that grasp by friction."""

from __future__ import annotations

from mani_skill.utils.structs import Actor

from hab_tasks.errors import OptionError
from hab_tasks.robots.friction_grasp import FrictionGrasp
from hab_tasks.robots.grasp import Grasp
from hab_tasks.robots.handle import Handle
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.robots.snap_grasp import SnapGrasp


def hand_of(
    agent: MobileManipulator, objects: list[Actor], handles: list[Handle], takes: str
) -> Grasp:
    """Returns what grasps objects, handles or both (`SnapGrasp`), as the robot's hand does.

    Raises:
        OptionError: Joints are set directly, and fingers cannot hold by friction meanwhile.
    """
    config, fingers = agent.controller.config, agent.spec.fingers
    if fingers is None:
        pulls_along = config.arm == "joint_state"
        return SnapGrasp(agent, objects, handles, takes, pulls_along=pulls_along)
    if config.sets_joints:
        mode = agent.control_mode
        raise OptionError.of_value("control_mode", mode, "one that drives joints, with friction")
    return FrictionGrasp(agent, objects, handles, fingers)
