"""Collision checks in the simulator, as ground truth for the planner's collision model.

SAPIEN reports the contacts of its last step, so each check sets the state and simulates one step of
a microsecond: collision detection is the same as in any step, and bodies move by micrometres at
most. The step is run by the physics system directly, without the environment's own code.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]  # compiled, no stubs
import sapien
import torch

from hab_spa.planning.collision import ArmCollision, CollisionConfig
from hab_spa.planning.items import moving_links
from hab_spa.shapes import Array
from hab_tasks.privileged import PrivilegedState
from hab_tasks.robots.kinematics import arm_model
from hab_tasks.simulator import sapien_object

STEP_S = 1e-6
NEAR_M = 0.01


class SimulatorCheck:
    """Collision checks of arm poses in the simulation of an environment with one row.

    The environment must be reset before further use.

    Attributes:
        checks: Number of collision checks so far.
    """

    def __init__(self, env: Any) -> None:
        """Takes an environment that has been reset to an episode."""
        core = env.unwrapped
        self.checks, state = 0, core.privileged()[0]
        scene = core.scene.sub_scenes[0]
        self._physics: Any = scene.physx_system
        self._robot: Any = sapien_object(core.agent.robot)
        self._arm, self._qpos = core.agent.arm_index.tolist(), self._robot.get_qpos()
        links: Any = {link.name: sapien_object(link) for link in core.agent.robot.links}
        self._hand = links[core.robot.ee_link]
        self._moving = {links[name].entity.per_scene_id for name in moving_links(core.robot)}
        self._held, self._hand_from_held = _held(scene, state), sapien.Pose()
        if self._held is not None:
            self._moving.add(self._held.per_scene_id)
            self._hand_from_held = self._hand.entity_pose.inv() * self._held.pose
        self._loose = {
            body.entity.per_scene_id: body.entity.pose
            for body in self._physics.rigid_dynamic_components
        }
        self._furniture = {
            link.entity.per_scene_id: link.articulation.get_qpos()
            for link in self._physics.articulation_link_components
            if link.is_root
        }
        self._physics.set_timestep(STEP_S)

    def is_free(self, qpos: Array) -> bool:
        """Whether an arm pose (J,) is free of contacts, including self-collisions."""
        self.checks += 1
        self._set(qpos)
        if self._held is not None:
            self._held.set_pose(self._hand.entity_pose * self._hand_from_held)
        self._physics.step()
        # No early exit, so that all bodies are restored.
        return not [c for c in self._physics.get_contacts() if self._touches(c)]

    def _set(self, qpos: Array) -> None:
        """Sets the arm's pose (J,)."""
        self._qpos[self._arm] = qpos
        self._robot.set_qpos(self._qpos)
        self._robot.set_qvel(np.zeros_like(self._qpos))

    def _touches(self, contact: Any) -> bool:
        """Whether a contact is one of the arm or the held object; restores the bodies it moved."""
        bodies = contact.bodies
        if not any(body.entity.per_scene_id in self._moving for body in bodies):
            return False
        # PhysX reports contacts before bodies touch.
        touches = any(point.separation < 0.0 for point in contact.points)
        for body in bodies if touches else ():
            self._put_back(body)
        return touches

    def _put_back(self, body: Any) -> None:
        """Restores a body that the step has pushed out of the arm."""
        if isinstance(body, sapien.physx.PhysxArticulationLinkComponent):
            furniture: Any = body.articulation
            if furniture is not self._robot:
                qpos = self._furniture[furniture.root.entity.per_scene_id]
                furniture.set_qpos(qpos)
                furniture.set_qvel(np.zeros_like(qpos))
        elif isinstance(body, sapien.physx.PhysxRigidDynamicComponent):
            body.entity.set_pose(self._loose[body.entity.per_scene_id])
            body.set_linear_velocity([0.0, 0.0, 0.0])
            body.set_angular_velocity([0.0, 0.0, 0.0])


class StateDictCheck(SimulatorCheck):
    """Collision checks that set the whole scene's state by ManiSkill's `set_state_dict`."""

    def __init__(self, env: Any) -> None:
        """See `SimulatorCheck`."""
        super().__init__(env)
        self._core = env.unwrapped
        self._state = self._core.get_state_dict()
        robot = self._state["articulations"][self._core.agent.robot.name]
        joints = robot.shape[1] - 2 * self._robot.dof
        self._arm_columns = [joints + column for column in self._arm]
        self._robot_row = robot[0]

    def _set(self, qpos: Array) -> None:
        self._robot_row[self._arm_columns] = torch.as_tensor(qpos, dtype=self._robot_row.dtype)
        self._core.set_state_dict(self._state)

    def _put_back(self, body: Any) -> None:
        """Does nothing: the next check sets the whole state."""


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """Agreement of the planner's collision model with the simulator on random arm poses.

    Attributes:
        poses: Number of poses.
        touching: Number of poses with a contact in the simulator.
        disagreements: Number of poses with different results.
        far: Number of disagreements that are not within a centimetre of the contact boundary.
    """

    poses: int
    touching: int
    disagreements: int
    far: int

    @property
    def percent(self) -> float:
        """Percentage of poses with the same result."""
        return 100.0 * (1.0 - self.disagreements / self.poses)


def agreement(env: Any, count: int, seed: int) -> Agreement:
    """Compares the planner's collision model with the simulator on random arm poses.

    Args:
        env: Environment, reset to an episode; it must be reset again before further use.
        count: Number of poses.
        seed: Seed of the poses.
    """
    core = env.unwrapped
    state = core.privileged()[0]
    model = ArmCollision(core.robot, state, state.held, CollisionConfig(margin_m=0.0))
    simulator = SimulatorCheck(env)
    touching = disagreements = far = 0
    shape = count, len(core.robot.arm_joints)
    for pose in np.random.default_rng(seed).uniform(*model.limits_rad, shape):
        free = simulator.is_free(pose)
        touching += not free
        if free != model.is_free(pose):
            disagreements += 1
            far += not _nearly(model, pose)
    return Agreement(poses=count, touching=touching, disagreements=disagreements, far=far)


class BroadPhaseCheck:
    """Collision checks of all pairs of a model by Pinocchio and coal, without the kernel."""

    def __init__(self, model: ArmCollision) -> None:
        """Takes the current placements and margins of a model that stands where it was made."""
        items, self._arm = model.items, arm_model(model.robot)[0]
        geometry, paired = pin.GeometryModel(), np.zeros((len(items.joint),) * 2, dtype=bool)
        for number in range(len(items.joint)):
            shape, offset = items.geometry(number)
            joint = max(0, int(items.joint[number]))
            pose = pin.SE3(items.pose[number] @ offset)
            geometry.addGeometryObject(pin.GeometryObject(str(number), joint, pose, shape))
        pairs, margins_m = model.pairs()
        paired[tuple(pairs.T)] = True
        geometry.setCollisionPairs(paired | paired.T)
        data = geometry.createData()
        for request, margin_m in zip(data.collisionRequests, margins_m, strict=True):
            request.security_margin = float(margin_m)
        self._data, self._kept = self._arm.createData(), geometry
        self._broad = pin.BroadPhaseManager_SSaPCollisionManager(self._arm, geometry, data)

    def is_free(self, qpos: Array) -> bool:
        """Whether the arm pose (J,) [rad] keeps every pair's margin."""
        return not pin.computeCollisions(self._arm, self._data, self._broad, qpos, True)


def kernel_agreement(model: ArmCollision, count: int, seed: int) -> tuple[int, int, int]:
    """Compares the model with coal on all pairs, on random poses and as many near contact.

    Args:
        model: The model, at its current margins.
        count: Number of random poses.
        seed: Their seed.

    Returns:
        Numbers of poses, of different answers, and of poses that only the model calls free.
    """
    shape = count, len(model.robot.arm_joints)
    poses = np.random.default_rng(seed).uniform(*model.limits_rad, shape)
    free = model.are_free(poses)
    clear, blocked = (poses[which][: min(free.sum(), (~free).sum())] for which in (free, ~free))
    for _ in range(10):  # within millimetres of contact
        middle = 0.5 * (clear + blocked)
        is_free = model.are_free(middle)[:, None]
        clear, blocked = np.where(is_free, middle, clear), np.where(is_free, blocked, middle)
    poses = np.concatenate((poses, clear, blocked))
    exact = BroadPhaseCheck(model)
    ours, theirs = model.are_free(poses), np.array([exact.is_free(pose) for pose in poses])
    return len(poses), int((ours != theirs).sum()), int((ours & ~theirs).sum())


def _nearly(model: ArmCollision, pose: Array) -> bool:
    """Whether the closest shapes are within a centimetre of the contact boundary."""
    model.set_margin(NEAR_M)
    distances_m = [contact.distance_m for contact in model.contacts(pose)]
    model.set_margin(0.0)
    return bool(distances_m) and min(distances_m) > -NEAR_M


def _held(scene: sapien.Scene, state: PrivilegedState) -> sapien.Entity | None:
    """Returns the held object; ManiSkill prefixes its name with the row."""
    if state.held is None:
        return None
    return next(e for e in scene.entities if e.name.split("_", 1)[-1] == state.held)
