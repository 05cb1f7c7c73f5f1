"""A physics scene without an environment around it, in which episodes are prepared and checked."""

from __future__ import annotations

import numpy as np
import sapien
import torch
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.envs.utils.system.backend import parse_sim_and_render_backend
from mani_skill.utils.structs.types import SimConfig
from sapien import physx

from hab_tasks.constants import CONTROL_HZ, SIM_HZ
from hab_tasks.geometry import Array, Pose7
from hab_tasks.privileged import CollisionBody
from hab_tasks.robots.fetch import HabFetch
from hab_tasks.robots.fetch_spec import ARM_JOINTS
from hab_tasks.scenes.build import build_scene, parking_pose
from hab_tasks.scenes.floor import FreeFloor, body_points, free_floor
from hab_tasks.scenes.shapes import components, matrix, read_body
from hab_tasks.scenes.spec import ObjectTemplate, SceneSpec

AWAY_M = 50.0
"""The robot waits this far outside while objects settle."""

TOUCH_DEPTH_M = 0.001
"""Robot links may overlap each other by this much: neighbours rest on one another."""

START_CLEARANCE_M = 0.015
"""Everything else must be at least this far from the robot where an episode starts."""

LOOSE_SETTLE_S = 5.0


class Workbench:
    """One layout with all movable objects and the robot, on the CPU.

    Attributes:
        settled: Loose object's handle -> pose after settling; empty in layouts without any.
        bodies: Body name -> its collision shapes (world only).
    """

    def __init__(self, spec: SceneSpec, objects: dict[str, ObjectTemplate]) -> None:
        self.spec, self.objects = spec, objects
        self._px = physx.PhysxCpuSystem()
        backend = parse_sim_and_render_backend("physx_cpu", "none")
        config = SimConfig(sim_freq=SIM_HZ, control_freq=CONTROL_HZ)
        self._scene = ManiSkillScene(
            [sapien.Scene([self._px])], sim_config=config, device=backend.device, backend=backend
        )
        self._px.timestep = 1.0 / SIM_HZ
        self._agent = HabFetch(self._scene, CONTROL_HZ, "ee")
        self.handles = build_scene(self._scene, spec, objects)
        self._scene._setup(enable_gpu=False)
        self._robot = self._agent.robot._objs[0]
        self._links = {link._objs[0] for link in self._agent.robot.links}
        self._components = {name: (group, body) for name, group, body in components(self.handles)}
        self.bodies: dict[str, CollisionBody] = {
            name: read_body(name, group, body) for name, (group, body) in self._components.items()
        }
        self.settled: dict[str, Pose7] = {}
        self.clear()
        if self.handles.loose:
            self.settle(LOOSE_SETTLE_S)
            self.settled = {name: self.pose(name) for name in self.handles.loose}

    def clear(self) -> None:
        """Parks all objects, sends the robot away, closes furniture and restores loose objects."""
        for index, name in enumerate(self.handles.pickables):
            self.place(name, parking_pose(index))
        for name, pose in self.settled.items():
            self.place(name, pose)
        for furniture in self.handles.articulations.values():
            furniture.set_qpos(torch.zeros_like(furniture.get_qpos()))
            furniture.set_qvel(torch.zeros_like(furniture.get_qpos()))
        self.send_robot_away()

    def set_joint(self, furniture: str, joint: str, value: float) -> None:
        """Moves one joint [m or rad]; furniture stays where it is put."""
        articulation = self.handles.articulations[furniture]
        qpos = articulation.get_qpos()
        index = [j.name for j in articulation.active_joints].index(joint)
        qpos[0, index] = value
        articulation.set_qpos(qpos)
        articulation.set_qvel(torch.zeros_like(qpos))

    def joint_limits(self, furniture: str, joint: str) -> tuple[float, float]:
        """Returns (lower, upper) of one joint [m or rad]."""
        articulation = self.handles.articulations[furniture]
        index = [j.name for j in articulation.active_joints].index(joint)
        low, high = articulation.get_qlimits()[0, index].tolist()
        return low, high

    def place(self, name: str, pose: Pose7) -> None:
        """Puts a movable object somewhere, at rest."""
        body = self._components[name][1]
        body.entity.pose = sapien.Pose(list(pose[:3]), list(pose[3:]))
        body.linear_velocity = np.zeros(3, dtype=np.float32)
        body.angular_velocity = np.zeros(3, dtype=np.float32)

    def pose(self, name: str) -> Pose7:
        """Returns where a movable object is."""
        pose = self._components[name][1].entity_pose
        return tuple(float(x) for x in (*pose.p, *pose.q))  # type: ignore[return-value]

    def com_m(self, name: str) -> Array:
        """Returns a movable object's centre of mass (3,) in the world."""
        body = self._components[name][1]
        return np.asarray((body.entity_pose * body.cmass_local_pose).p, dtype=float)

    def world_from(self, body: str) -> Array:
        """Returns the (4, 4) pose of any body."""
        return matrix(self._components[body][1].entity_pose)

    def settle(self, seconds: float, names: tuple[str, ...] = ()) -> None:
        """Lets physics run until `names` sleep (all loose objects if empty), `seconds` at most."""
        bodies = [self._components[n][1] for n in (names or tuple(self.handles.loose))]
        for step in range(round(seconds * SIM_HZ)):
            self._px.step()
            if step % 30 == 29 and all(body.is_sleeping for body in bodies):
                break

    def footprint(self, name: str) -> tuple[Array, float, float]:
        """Measures an object standing upright.

        Returns:
            The middle (3,) of its outline in its own frame, level with its origin; the outline's
            radius; how far it reaches below its origin [m].
        """
        up = np.array(self.objects[name].up)
        points = np.concatenate([body_points(s)[:3] for s in self.bodies[name].shapes], axis=1)
        heights = up @ points
        flat = points - np.outer(up, heights)
        middle = (flat.min(axis=1) + flat.max(axis=1)) / 2
        radius = np.linalg.norm(flat - middle[:, None], axis=0).max()
        return middle, float(radius), float(-heights.min())

    def floor(self) -> FreeFloor:
        """Returns the free floor with the furniture as it stands now."""
        fixed = [b for b in self.bodies.values() if b.group != "object"]
        return free_floor(fixed, {body.name: self.world_from(body.name) for body in fixed})

    def robot_touches(
        self, base: tuple[float, float, float], arm_qpos_rad: Array, clearance_m: float = 0.0
    ) -> bool:
        """Whether the robot touches itself there, or has a thing nearer than `clearance_m`."""
        qpos = self._agent.rest_qpos()
        qpos[self._agent.base_index] = torch.tensor(base, dtype=torch.float32)
        for name, value in zip(ARM_JOINTS, arm_qpos_rad, strict=True):
            qpos[self._agent.joint_index[name]] = float(value)
        self._robot.set_qpos(qpos.numpy())
        self._robot.set_qvel(np.zeros(len(qpos), dtype=np.float32))
        self._px.step()
        for contact in self._px.get_contacts():
            robots = sum(body in self._links for body in contact.bodies)
            limit_m = clearance_m if robots == 1 else -TOUCH_DEPTH_M
            if robots and any(point.separation < limit_m for point in contact.points):
                return True
        return False

    def send_robot_away(self) -> None:
        """Moves the robot out of the layout."""
        qpos = self._agent.rest_qpos()
        qpos[self._agent.base_index[0]] = AWAY_M
        self._robot.set_qpos(qpos.numpy())
        self._robot.set_qvel(np.zeros(len(qpos), dtype=np.float32))
