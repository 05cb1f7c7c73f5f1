"""The robot in a placement sandbox: parked, set to a pose, and checked for contacts."""

from __future__ import annotations

from typing import Any

import numpy as np
from mani_skill.envs.scene import ManiSkillScene
from numpy.typing import NDArray

from hab_tasks.constants import CONTROL_HZ
from hab_tasks.geometry import Array
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.robots.spec import RobotSpec, agent_class
from hab_tasks.simulator import sapien_object, set_up

JointPositions = NDArray[np.float32]

AWAY_M = 50.0
"""Parking distance of the robot while objects settle."""

TOUCH_DEPTH_M = 0.001
"""Allowed overlap of robot links, as adjacent links touch."""


class SandboxRobot:
    """The robot, built as the first body of a simulation, as ManiSkill's `agent`."""

    def __init__(self, scene: ManiSkillScene, robot: RobotSpec) -> None:
        """Builds the robot in an empty scene."""
        self._scene = scene
        self.agent: MobileManipulator = agent_class(robot)(scene, CONTROL_HZ, "ee")
        set_up(scene)
        self._robot = sapien_object(self.agent.robot)
        links = [sapien_object(link) for link in self.agent.robot.links]
        # A link has a weak reference to its entity.
        self._links, self._entities = set(links), [link.entity for link in links]
        self._rest_qpos: JointPositions = self.agent.rest_qpos().numpy()
        self._base, self._arm = self.agent.base_index.numpy(), self.agent.arm_index.numpy()

    def leave(self) -> None:
        """Removes the robot from its scene, in the state in which it was built."""
        set_joints(self._robot, np.zeros_like(self._rest_qpos))
        for joint in self._robot.active_joints:
            joint.set_drive_target(0.0)
            joint.set_drive_velocity_target(0.0)
        for entity in self._entities:
            entity.remove_from_scene()

    def enter(self) -> None:
        """Adds the robot to the new simulation of its scene."""
        for entity in self._entities:
            self._scene.sub_scenes[0].add_entity(entity)
        set_up(self._scene)

    def stand(self, base: tuple[float, float, float], arm_qpos_rad: Array) -> None:
        """Sets the robot to a pose, at rest."""
        qpos = self._rest_qpos.copy()
        qpos[self._base], qpos[self._arm] = base, arm_qpos_rad
        set_joints(self._robot, qpos)

    def park(self) -> None:
        """Parks the robot outside the layout."""
        qpos = self._rest_qpos.copy()
        qpos[self._base[0]] = AWAY_M
        set_joints(self._robot, qpos)

    def in_contact(self, contacts: list[Any], clearance_m: float) -> bool:
        """Whether contacts of the last step have the robot closer to a body than allowed."""
        for contact in contacts:
            one, other = contact.bodies
            robots = (one in self._links) + (other in self._links)
            limit_m = clearance_m if robots == 1 else -TOUCH_DEPTH_M
            if robots and any(point.separation < limit_m for point in contact.points):
                return True
        return False


def set_joints(articulation: Any, qpos: JointPositions) -> None:
    """Sets the joints of a SAPIEN articulation, at rest."""
    articulation.set_qpos(qpos)
    articulation.set_qvel(np.zeros_like(qpos))
