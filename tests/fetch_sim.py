"""Fixture: the robot at rest with boxes around its hand."""

import numpy as np
import torch
from builders import box_actor, cpu_scene, start_fetch

from hab_tasks.robots.fetch.agent import HabFetch
from hab_tasks.robots.hand import hand_of

GRASP, RELEASE = 1.0, -1.0
HAND_M = np.array([0.50004, 1.5e-5, 1.005])
"""The resting end-effector; the base's frame is 5 mm above the floor."""


class FetchSim:
    """The robot at rest on an endless plane, stepped as the environments do it.

    Attributes:
        speeds: Largest joint speed [rad/s, m/s] of each simulation step.
    """

    def __init__(self, mode, boxes=(), statics=(), *, floating=True, robot=HabFetch):
        """Makes boxes and walls from half extents and offsets from the hand [m]."""
        self.scene = cpu_scene()
        self.agent = robot(self.scene, 30, mode)
        self.objects = [
            box_actor(self.scene, f"box{i}", half, tuple(HAND_M + offset))
            for i, (half, offset) in enumerate(boxes)
        ]
        for i, (half, offset) in enumerate(statics):
            box_actor(self.scene, f"wall{i}", half, tuple(HAND_M + offset), static=True)
        self.scene._setup(enable_gpu=False)
        start_fetch(self.agent)
        for actor in self.objects:
            actor._bodies[0].disable_gravity = floating
        self.controller = self.agent.controller
        self.grasp = hand_of(self.agent, self.objects, [], "objects")
        self.speeds = [0.0]

    def act(self, action, gripper=RELEASE, *, steps=1):
        """Carries out an action (A,) some times; returns the impulses on the robot [N s]."""
        links = {link._objs[0] for link in self.agent.robot.links}
        impulse = 0.0
        for _ in range(steps):
            self.controller.set_action(torch.as_tensor(np.float32(action)).reshape(1, -1))
            if self.objects:
                self.grasp.command(gripper)
            for number in range(4):
                if self.controller.config.sets_joints:
                    self.controller.move_joints((number + 1) / 4)
                    self.grasp.carry()
                self.grasp.before_physics_step()
                self.scene.px.step()
                self.speeds.append(float(self.agent.robot.get_qvel().abs().max()))
                impulse += sum(
                    float(np.linalg.norm(point.impulse))
                    for contact in self.scene.px.get_contacts()
                    if links & set(contact.bodies)
                    for point in contact.points
                )
            if self.objects:
                self.grasp.after_control_step()
        return impulse

    def idle(self, *, holding=False):
        return self.controller.idle_action(holding)

    def arm(self):
        return self.agent.robot.get_qpos()[0, self.agent.arm_index].numpy()

    def base(self):
        return self.agent.robot.get_qpos()[0, self.agent.base_index].numpy()

    def in_hand(self, index=0):
        """An object's pose (7,) in the hand."""
        return (self.agent.ee_link.pose.inv() * self.objects[index].pose).raw_pose[0].numpy()
