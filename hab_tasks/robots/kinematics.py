"""Forward kinematics and Jacobian of Fetch's arm in the base frame, and the paper's IK step.

One row goes through Pinocchio (microseconds); a batch goes through pytorch_kinematics, which
runs on any device. Both read the same URDF; a test holds them together.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]  # compiled, no stubs
import torch
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv  # pyright: ignore[reportAttributeAccessIssue]  # made at import
from torch import Tensor

from hab_tasks.robots.fetch_spec import (
    ARM_JOINTS,
    ARM_LOWER_RAD,
    ARM_UPPER_RAD,
    BASE_JOINTS,
    EE_LINK,
    EE_OFFSET_M,
    LOCKED_QPOS,
    urdf_path,
)

Array = NDArray[np.float64]

_LOWER = np.array(ARM_LOWER_RAD)
_UPPER = np.array(ARM_UPPER_RAD)
_EYE = np.eye(3)


@lru_cache(maxsize=1)
def _arm_urdf() -> str:
    """The URDF with the arm's continuous joints made revolute, so that q is 7 plain angles."""
    text = urdf_path().read_text()
    ranges = zip(ARM_LOWER_RAD, ARM_UPPER_RAD, strict=True)
    limits: dict[str | None, tuple[float, float]] = dict(zip(ARM_JOINTS, ranges, strict=True))
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
        elif joint.get("name") in BASE_JOINTS:
            joint.set("type", "fixed")
    return ElementTree.tostring(root, encoding="unicode")


def arm_model() -> tuple[pin.Model, int]:
    """Builds Fetch's arm with base, torso and head locked.

    Returns:
        A Pinocchio model with 7 joints in `ARM_JOINTS` order, its root at base_link, and the id
        of the frame ``ee`` (the end-effector point).
    """
    full = pin.buildModelFromXML(_arm_urdf())
    q = pin.neutral(full)
    for name, value in LOCKED_QPOS.items():
        q[full.joints[full.getJointId(name)].idx_q] = value
    locked = [i for i, name in enumerate(full.names) if i > 0 and name not in ARM_JOINTS]
    model = pin.buildReducedModel(full, locked, q)
    link = model.frames[model.getFrameId(EE_LINK)]
    offset = pin.SE3(np.eye(3), np.array([EE_OFFSET_M, 0.0, 0.0]))
    ee = pin.Frame(
        "ee", link.parentJoint, model.getFrameId(EE_LINK), link.placement * offset,
        pin.FrameType.OP_FRAME,
    )  # fmt: skip
    return model, model.addFrame(ee)


class ArmKinematics:
    """End-effector position and Jacobian of the arm, in the base frame."""

    def __init__(self) -> None:
        self._model, self._ee = arm_model()
        self._data = self._model.createData()
        self._chain: Any = None

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

    def move(
        self, qpos: Array, step_m: Array, lower_m: Array, upper_m: Array, damping: float = 0.02
    ) -> Array:
        """`displace` by `step_m` (3,) from where the arm (7,) is, kept within a box."""
        position, jacobian = self.position_and_jacobian(qpos)
        goal = np.minimum(np.maximum(position + step_m, lower_m), upper_m)
        return _damped_step(qpos, jacobian, goal - position, damping)

    def batch_position_and_jacobian(self, qpos: Tensor) -> tuple[Tensor, Tensor]:
        """The same for (N, 7) rows on any device: (N, 3) and (N, 3, 7)."""
        chain = self._torch_chain().to(device=qpos.device, dtype=qpos.dtype)
        torso = torch.full_like(qpos[:, :1], LOCKED_QPOS["torso_lift_joint"])
        chain_qpos = torch.cat((torso, qpos), dim=1)
        pose = chain.forward_kinematics(chain_qpos).get_matrix()
        offset = torch.zeros(3, device=qpos.device, dtype=qpos.dtype)
        offset[0] = EE_OFFSET_M
        position = pose[:, :3, 3] + pose[:, :3, :3] @ offset
        jacobian = chain.jacobian(chain_qpos, locations=offset.expand(len(qpos), 3))
        return position, jacobian[:, :3, 1:]

    def batch_displace(self, qpos: Tensor, target_m: Tensor, damping: float = 0.02) -> Tensor:
        """`displace` for (N, 7) rows and (N, 3) targets."""
        position, jacobian = self.batch_position_and_jacobian(qpos)
        lower = torch.tensor(ARM_LOWER_RAD, device=qpos.device, dtype=qpos.dtype)
        upper = torch.tensor(ARM_UPPER_RAD, device=qpos.device, dtype=qpos.dtype)
        error = target_m - position
        wanted = qpos + _solve_batch(jacobian, error, damping)
        moved = torch.minimum(torch.maximum(wanted, lower), upper)
        left = error - (jacobian @ (moved - qpos).unsqueeze(-1)).squeeze(-1)
        # Joints that a limit stopped take no part in the second solve; without any, it adds nothing
        # that the damping of the first did not leave.
        free = (moved == wanted).unsqueeze(1)
        stopped = ~free.squeeze(1).all(dim=1, keepdim=True)
        again = moved + stopped * _solve_batch(jacobian * free, left, damping)
        return torch.minimum(torch.maximum(again, lower), upper)

    def _torch_chain(self) -> Any:
        if self._chain is None:
            # Takes seconds, and only batches need it.
            import pytorch_kinematics as pk

            self._chain = pk.build_serial_chain_from_urdf(
                _arm_urdf(), EE_LINK, root_link_name="base_link"
            )
        return self._chain


def _damped_step(qpos: Array, jacobian: Array, error_m: Array, damping: float) -> Array:
    """Solves once, and once more with the other joints if a limit stopped some."""
    wanted = qpos + _solve(jacobian, error_m, damping)
    moved = np.minimum(np.maximum(wanted, _LOWER), _UPPER)
    free = moved == wanted
    if free.all():
        return moved
    left_m = error_m - jacobian @ (moved - qpos)
    again = moved + _solve(jacobian * free, left_m, damping)
    return np.minimum(np.maximum(again, _LOWER), _UPPER)


def _solve(jacobian: Array, error_m: Array, damping: float) -> Array:
    gram = jacobian @ jacobian.T + damping**2 * _EYE
    # LAPACK directly: numpy's solve spends ten times longer on its own checks than on a 3 x 3.
    _, weights, _ = dposv(gram, error_m)
    return jacobian.T @ weights


def _solve_batch(jacobian: Tensor, error_m: Tensor, damping: float) -> Tensor:
    gram = jacobian @ jacobian.transpose(1, 2)
    gram = gram + damping**2 * torch.eye(3, device=gram.device, dtype=gram.dtype)
    weights = torch.linalg.solve(gram, error_m.unsqueeze(-1))
    return (jacobian.transpose(1, 2) @ weights).squeeze(-1)
