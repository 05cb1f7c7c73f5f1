"""Forward kinematics and Jacobian of Fetch's arm in the base frame, and the paper's IK step."""

from __future__ import annotations

from functools import lru_cache
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]  # compiled, no stubs
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv  # pyright: ignore[reportAttributeAccessIssue]  # made at import

from hab_tasks.robots.robot import ROBOT

Array = NDArray[np.float64]

_LOWER = np.array(ROBOT.arm_lower_rad)
_UPPER = np.array(ROBOT.arm_upper_rad)
_EYE = np.eye(3)


@lru_cache(maxsize=1)
def _arm_urdf() -> str:
    """Returns the URDF with revolute instead of continuous arm joints, so that q is 7 angles."""
    text = ROBOT.urdf_path().read_text()
    ranges = zip(ROBOT.arm_lower_rad, ROBOT.arm_upper_rad, strict=True)
    limits: dict[str | None, tuple[float, float]] = dict(zip(ROBOT.arm_joints, ranges, strict=True))
    root = ElementTree.fromstring(text)
    for joint in root.iter("joint"):
        if joint.get("name") in limits and joint.get("type") == "continuous":
            low, high = limits[joint.get("name")]
            joint.set("type", "revolute")
            limit = joint.find("limit")
            if limit is None:
                limit = ElementTree.SubElement(joint, "limit", effort="10", velocity="1.5")
            limit.set("lower", str(low))
            limit.set("upper", str(high))
        elif joint.get("name") in ROBOT.base_joints:
            joint.set("type", "fixed")
    return ElementTree.tostring(root, encoding="unicode")


def arm_model() -> tuple[pin.Model, int]:
    """Builds Fetch's arm with base, torso and head locked.

    Returns:
        A Pinocchio model with 7 joints in the arm's order and its root at base_link, and the id of
        the frame ``ee`` (the end-effector point).
    """
    full = pin.buildModelFromXML(_arm_urdf())
    q = pin.neutral(full)
    for name, value in ROBOT.locked_qpos.items():
        q[full.joints[full.getJointId(name)].idx_q] = value
    locked = [i for i, name in enumerate(full.names) if i > 0 and name not in ROBOT.arm_joints]
    model = pin.buildReducedModel(full, locked, q)
    link = model.frames[model.getFrameId(ROBOT.ee_link)]
    offset = pin.SE3(np.eye(3), np.array([ROBOT.ee_offset_m, 0.0, 0.0]))
    ee = pin.Frame(
        "ee", link.parentJoint, model.getFrameId(ROBOT.ee_link), link.placement * offset,
        pin.FrameType.OP_FRAME,
    )  # fmt: skip
    return model, model.addFrame(ee)


_shared_arm_model = lru_cache(maxsize=1)(arm_model)


class ArmKinematics:
    """End-effector position and Jacobian of the arm, in the base frame."""

    def __init__(self) -> None:
        self._model, self._ee = _shared_arm_model()
        self._data = self._model.createData()

    def position(self, qpos: Array) -> Array:
        """Returns the (3,) end-effector position [m] of one arm pose (7,) [rad]."""
        pin.forwardKinematics(self._model, self._data, qpos)
        return pin.updateFramePlacement(self._model, self._data, self._ee).translation.copy()

    def position_and_jacobian(self, qpos: Array) -> tuple[Array, Array]:
        """Returns (3,) [m] and the (3, 7) positional Jacobian [m/rad] of one arm pose (7,)."""
        jacobian = pin.computeFrameJacobian(
            self._model, self._data, qpos, self._ee, pin.LOCAL_WORLD_ALIGNED
        )
        return self._data.oMf[self._ee].translation, jacobian[:3]

    def displace(self, qpos: Array, target_m: Array, damping: float = 0.02) -> Array:
        """One damped-least-squares step of the arm (7,) towards an end-effector target (3,).

        dq = J^T (J J^T + damping^2 I)^-1 (target - position), then the joint limits.
        """
        position, jacobian = self.position_and_jacobian(qpos)
        return _damped_step(qpos, jacobian, target_m - position, damping)

    def approach(self, qpos: Array, target_m: Array, steps: int, damping: float) -> Array:
        """Returns the arm (7,) after a number of steps of `displace` towards a target (3,)."""
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

    def move(
        self, qpos: Array, step_m: Array, lower_m: Array, upper_m: Array, damping: float = 0.02
    ) -> Array:
        """`displace` by `step_m` (3,) from the current arm pose (7,), clipped to a box."""
        position, jacobian = self.position_and_jacobian(qpos)
        goal = np.minimum(np.maximum(position + step_m, lower_m), upper_m)
        return _damped_step(qpos, jacobian, goal - position, damping)


def _damped_step(qpos: Array, jacobian: Array, error_m: Array, damping: float) -> Array:
    """Solves once, and again without the joints that reached a limit, if any."""
    wanted = qpos + _solve(jacobian, error_m, damping)
    moved = np.minimum(np.maximum(wanted, _LOWER), _UPPER)
    if moved.tobytes() == wanted.tobytes():
        return moved
    free = moved == wanted
    left_m = error_m - jacobian @ (moved - qpos)
    again = moved + _solve(jacobian * free, left_m, damping)
    return np.minimum(np.maximum(again, _LOWER), _UPPER)


def _solve(jacobian: Array, error_m: Array, damping: float) -> Array:
    gram = jacobian @ jacobian.T + _damping_matrix(damping)
    # Call LAPACK directly: for a 3 x 3 system, numpy's checks take ten times as long as solving.
    _, weights, _ = dposv(gram, error_m)
    return jacobian.T @ weights


@lru_cache(maxsize=16)
def _damping_matrix(damping: float) -> Array:
    return damping**2 * _EYE
