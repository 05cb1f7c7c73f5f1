"""Fixture: the apartment's kitchen with the robot's hand at one of its handles."""

import numpy as np
import sapien
import torch
from builders import cpu_scene

from hab_tasks.robots.fetch.agent import HabFetch
from hab_tasks.robots.handle import Handle
from hab_tasks.robots.snap_grasp import SnapGrasp
from hab_tasks.world.scenes.habitat.dataset import resolve_dataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.pool import BodyPool

GRASP, RELEASE = 1.0, -1.0


class Kitchen:
    """One handle of the apartment's furniture, the robot in front of it, its hand on the marker."""

    def __init__(self, marker, *, pulls_along=False):
        dataset = resolve_dataset("apartment")
        spec = load_scene(dataset, sorted(dataset.scene_files)[0])
        self.scene = cpu_scene()
        self.agent = HabFetch(self.scene, 30, "ee_base")
        built = BodyPool(self.scene, {}).show(spec, ())
        self.scene._setup(enable_gpu=False)
        name = next(n for n in built.articulations if n.startswith(marker.template + "_:"))
        furniture = built.articulations[name]
        self.link = furniture.links_map[marker.link]
        self.handle = Handle(
            name=marker.name,
            furniture_name=name,
            furniture=furniture,
            link=self.link,
            offset_m=marker.offset_m,
        )
        self.furniture = furniture
        self.grasp = SnapGrasp(self.agent, [], [self.handle], pulls_along=pulls_along)
        for link in self.agent.robot.links:  # only the constraint shall move the door
            for shape in link._objs[0].collision_shapes:
                shape.set_collision_groups([0, 0, 0, 0])
        self.stand()

    def position(self):
        index = [j.name for j in self.furniture.active_joints].index(self.link.joint.name)
        return float(self.furniture.get_qpos()[0, index])

    def gap_m(self):
        return float(np.linalg.norm(self.handle.pose().p - self.grasp.ee_position_m()))

    def act(self, move=lambda: None):
        """Runs the physics of an action, and goes on grasping; `move` is called in each step."""
        self.grasp.command(GRASP)
        for _ in range(4):
            move()
            self.grasp.carry()
            self.grasp.before_physics_step()
            self.scene.px.step()
        self.grasp.after_control_step()

    def stand(self):
        """Places the base so that the hand, at rest height or not, is on the marker."""
        marker = self.handle.pose().p
        qpos = self.agent.rest_qpos()[None]
        qpos[0, self.agent.base_index] = torch.tensor([marker[0] - 0.5, marker[1], 0.0])
        self.agent.robot.set_root_pose(sapien.Pose([0, 0, float(marker[2]) - 1.0]))
        self.agent.robot.set_qpos(qpos)
        self.agent.robot.set_qvel(torch.zeros_like(qpos))
        self.agent.controller.reset()


def opening_direction(kitchen):
    """Level direction (2,) in which the marker goes when the joint opens a little."""
    index = [j.name for j in kitchen.furniture.active_joints].index(kitchen.link.joint.name)
    start = kitchen.handle.pose().p[:2]
    qpos = kitchen.furniture.get_qpos().clone()
    closed = qpos.clone()
    qpos[0, index] += 0.05
    kitchen.furniture.set_qpos(qpos)
    moved = kitchen.handle.pose().p[:2] - start
    kitchen.furniture.set_qpos(closed)
    return moved / np.linalg.norm(moved)
