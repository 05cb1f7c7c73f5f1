"""Forward kinematics and Jacobian of a robot's arm in the base frame, and the paper's IK step."""

from __future__ import annotations

from functools import cache, lru_cache
from math import pi
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]  # compiled, no stubs
from scipy.linalg.lapack import dposv  # pyright: ignore[reportAttributeAccessIssue]  # made at import

from hab_tasks.geometry import Array
from hab_tasks.robots.spec import RobotSpec

_EYE = np.eye(3)


def _arm_urdf(robot: RobotSpec) -> str:
    """Returns the URDF with revolute instead of continuous joints: q is one angle each."""
    ranges = zip(robot.arm_lower_rad, robot.arm_upper_rad, strict=True)
    # Pinocchio has cosine and sine for a continuous joint, where `locked_qpos` has its angle.
    limits: dict[str | None, tuple[float, float]] = dict.fromkeys(robot.locked_qpos, (-pi, pi))
    limits.update(zip(robot.arm_joints, ranges, strict=True))
    root = robot.urdf_tree()
    for joint in root.iter("joint"):
        if joint.get("name") in limits and joint.get("type") == "continuous":
            low, high = limits[joint.get("name")]
            joint.set("type", "revolute")
            limit = joint.find("limit")
            if limit is None:
                limit = ElementTree.SubElement(joint, "limit", effort="10", velocity="1.5")
            limit.set("lower", str(low))
            limit.set("upper", str(high))
        elif joint.get("name") in robot.base_joints:
            joint.set("type", "fixed")
    return ElementTree.tostring(root, encoding="unicode")


@cache
def arm_model(robot: RobotSpec) -> tuple[pin.Model, int]:
    """Returns a robot's arm with the other joints locked; built once, do not modify.

    Returns:
        A Pinocchio model with the arm's joints in order and its root at base_link, and the id of
        the frame ``ee`` (the end-effector point).
    """
    full = pin.buildModelFromXML(_arm_urdf(robot))
    q = pin.neutral(full)
    for name, value in robot.locked_qpos.items():
        q[full.joints[full.getJointId(name)].idx_q] = value
    locked = [i for i, name in enumerate(full.names) if i > 0 and name not in robot.arm_joints]
    model = pin.buildReducedModel(full, locked, q)
    link = model.frames[model.getFrameId(robot.ee_link)]
    offset = pin.SE3(np.eye(3), np.array([robot.ee_offset_m, 0.0, 0.0]))
    ee = pin.Frame(
        "ee", link.parentJoint, model.getFrameId(robot.ee_link), link.placement * offset,
        pin.FrameType.OP_FRAME,
    )  # fmt: skip
    return model, model.addFrame(ee)


class ArmKinematics:
    """End-effector position and Jacobian of the arm, in the base frame."""

    def __init__(self, robot: RobotSpec) -> None:
        self.robot = robot
        self._model, self._ee = arm_model(robot)
        self.arm_lower_rad = np.array(robot.arm_lower_rad)
        self.arm_upper_rad = np.array(robot.arm_upper_rad)
        self._ee_lower_m, self._ee_upper_m = np.array(robot.ee_lower_m), np.array(robot.ee_upper_m)
        self._data = self._model.createData()

    def position(self, qpos: Array) -> Array:
        """Returns the (3,) end-effector position [m] of one arm pose (J,) [rad]."""
        pin.forwardKinematics(self._model, self._data, qpos)
        return pin.updateFramePlacement(self._model, self._data, self._ee).translation.copy()

    def pose(self, qpos: Array) -> Array:
        """Returns the end-effector's pose (4, 4) of one arm pose (J,) [rad]."""
        pin.forwardKinematics(self._model, self._data, qpos)
        return pin.updateFramePlacement(self._model, self._data, self._ee).homogeneous

    def position_and_jacobian(self, qpos: Array) -> tuple[Array, Array]:
        """Returns (3,) [m] and the (3, J) positional Jacobian [m/rad] of one arm pose (J,)."""
        jacobian = pin.computeFrameJacobian(
            self._model, self._data, qpos, self._ee, pin.LOCAL_WORLD_ALIGNED
        )
        return self._data.oMf[self._ee].translation, jacobian[:3]

    def displace(self, qpos: Array, target_m: Array, damping: float = 0.02) -> Array:
        """One damped-least-squares step of the arm (J,) towards an end-effector target (3,).

        dq = J^T (J J^T + damping^2 I)^-1 (target - position), then the joint limits.
        """
        position, jacobian = self.position_and_jacobian(qpos)
        return self._damped_step(qpos, jacobian, target_m - position, damping)

    def approach(self, qpos: Array, target_m: Array, steps: int, damping: float) -> Array:
        """Returns the arm (J,) after a number of steps of `displace` towards a target (3,)."""
        path: list[Array] = []
        number: dict[bytes, int] = {}
        for step in range(steps):
            # At the target, the last digits repeat with a short period, and so does the rest.
            first = number.setdefault(qpos.tobytes(), step)
            if first < step:
                return path[first + (steps - first) % (step - first)]
            path.append(qpos)
            qpos = self.displace(qpos, target_m, damping)
        return qpos

    def move(self, qpos: Array, step_m: Array, damping: float = 0.02) -> Array:
        """`displace` by `step_m` (3,) from the current arm pose (J,), within the workspace box."""
        position, jacobian = self.position_and_jacobian(qpos)
        goal = np.minimum(np.maximum(position + step_m, self._ee_lower_m), self._ee_upper_m)
        return self._damped_step(qpos, jacobian, goal - position, damping)

    def _damped_step(self, qpos: Array, jacobian: Array, error_m: Array, damping: float) -> Array:
        """Solves once, and again without the joints that reached a limit, if any."""
        lower, upper = self.arm_lower_rad, self.arm_upper_rad
        wanted = qpos + _solve(jacobian, error_m, damping)
        moved = np.minimum(np.maximum(wanted, lower), upper)
        if moved.tobytes() == wanted.tobytes():
            return moved
        free = moved == wanted
        left_m = error_m - jacobian @ (moved - qpos)
        again = moved + _solve(jacobian * free, left_m, damping)
        return np.minimum(np.maximum(again, lower), upper)


def _solve(jacobian: Array, error_m: Array, damping: float) -> Array:
    gram = jacobian @ jacobian.T + _damping_matrix(damping)
    # Call LAPACK directly: for a 3 x 3 system, numpy's checks take ten times as long as solving.
    _, weights, _ = dposv(gram, error_m)
    return jacobian.T @ weights


@lru_cache(maxsize=16)
def _damping_matrix(damping: float) -> Array:
    return damping**2 * _EYE
