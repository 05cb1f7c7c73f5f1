"""Damped least squares of the arm in batches, compiled by numba; see `hab_spa.planning.ik`."""

from __future__ import annotations

from math import acos, atan2, sin, sqrt

import numpy as np

from hab_spa.planning.batch import Floats
from hab_spa.planning.gjk import called, inlined, out_of
from hab_spa.planning.kernel import compiled, kinematics

TURN, DAMPING_OF_TRACKING = 3, 0.02
"""First row of the error's rotation; damping as in `BatchArm.track_pose`."""


@inlined
def _jacobian(
    chain: Floats, joints: Floats, point: tuple[float, float, float], out: Floats
) -> None:
    """Writes the Jacobian (6, J) of a point: translation, then rotation."""
    for j in range(len(chain)):
        axis, slides = int(chain[j, 12]) % 3, chain[j, 12] > 2.0
        a, b, c = joints[j + 1, axis], joints[j + 1, 3 + axis], joints[j + 1, 6 + axis]
        x = point[0] - joints[j + 1, 9]
        y = point[1] - joints[j + 1, 10]
        z = point[2] - joints[j + 1, 11]
        out[0, j], out[1, j], out[2, j] = b * z - c * y, c * x - a * z, a * y - b * x
        out[3, j], out[4, j], out[5, j] = a, b, c
        if slides:
            out[0, j], out[1, j], out[2, j] = a, b, c
            out[3, j] = out[4, j] = out[5, j] = 0.0


@called
def _move(
    jacobian: Floats, error: Floats, rows: int, damping: float, gram: Floats, q: Floats,
    b: int, limits: Floats,
) -> None:  # fmt: skip
    """Moves a pose by J^T (J J^T + damping^2 I)^-1 error within the limits, by Cholesky."""
    for i in range(rows):
        for k in range(i + 1):
            total = damping * damping if i == k else 0.0
            for j in range(jacobian.shape[1]):
                total += jacobian[i, j] * jacobian[k, j]
            for m in range(k):
                total -= gram[i, m] * gram[k, m]
            gram[i, k] = sqrt(total) if i == k else total / gram[k, k]
    for i in range(rows):
        for m in range(i):
            error[i] -= gram[i, m] * error[m]
        error[i] /= gram[i, i]
    for i in range(rows - 1, -1, -1):
        for m in range(i + 1, rows):
            error[i] -= gram[m, i] * error[m]
        error[i] /= gram[i, i]
    for j in range(jacobian.shape[1]):
        total = q[b, j]
        for i in range(rows):
            total += jacobian[i, j] * error[i]
        q[b, j] = min(max(total, limits[0, j]), limits[1, j])


@inlined
def _righting(joints: Floats, tool: Floats, jacobian: Floats, error: Floats) -> float:
    """Writes the rows of the rotation about x and y that turns a tool upright; returns its tilt."""
    wrist = jacobian.shape[1]
    x = joints[wrist, 0] * tool[3] + joints[wrist, 1] * tool[4] + joints[wrist, 2] * tool[5]
    y = joints[wrist, 3] * tool[3] + joints[wrist, 4] * tool[4] + joints[wrist, 5] * tool[5]
    z = joints[wrist, 6] * tool[3] + joints[wrist, 7] * tool[4] + joints[wrist, 8] * tool[5]
    across = sqrt(x * x + y * y)
    tilt = atan2(across, z)
    turn = tool[6] * tilt / max(across, 1e-9) * min(1.0, tool[8] / max(tilt, 1e-9))
    # The axis of the shortest turn: the tool's direction times z is (y, -x, 0).
    error[3], error[4] = turn * y, -turn * x
    for j in range(jacobian.shape[1]):
        jacobian[3, j] *= tool[6]
        jacobian[4, j] *= tool[6]
    return tilt


@compiled
def solve(
    chain: Floats, limits: Floats, tool: Floats, q: Floats, targets_m: Floats, settings: Floats,
    reached: Floats,
) -> None:  # fmt: skip
    """Moves arm poses (B, J) to targets (B, 3), as `BatchArm.solve`.

    Args:
        chain: See `Shapes`.
        limits: (2, J) lower and upper limits.
        tool: (9,) point in the wrist's frame, upright direction, weight, tilt and step of `Tool`;
            a weight of 0 for the end-effector.
        q: The poses, changed in place.
        targets_m: The targets.
        settings: (4,) the fields of `IkConfig`.
        reached: (B,) 1 where the target is reached, else 0.
    """
    joints, jacobian, gram, error = (
        np.zeros((len(chain) + 2, 12)),
        np.empty((6, len(chain))),
        np.empty((6, 6)),
        np.empty(6),
    )
    joints[0, 0] = joints[0, 4] = joints[0, 8] = 1.0
    steps, damping, step_m, near_m = settings[0], settings[1], settings[2], 0.5 * settings[3]
    for b in range(len(q)):
        # One more than moves: the last time, the pose is only measured.
        for step in range(int(steps) + 1):
            kinematics(chain, q, b, joints)
            point = out_of(joints, len(chain), tool[0], tool[1], tool[2])
            away2 = 0.0
            for i in range(3):
                error[i] = targets_m[b, i] - point[i]
                away2 += error[i] * error[i]
            away = sqrt(away2)
            done, rows = away < near_m, 3
            reached[b] = 1.0 if done else 0.0
            scale = min(1.0, step_m / max(away, 1e-9))
            for i in range(3):
                error[i] *= scale
            _jacobian(chain, joints, point, jacobian)
            if tool[6] > 0.0:
                tilt, rows = _righting(joints, tool, jacobian, error), 5
                done = done and tilt < tool[7]
            if done or step == int(steps):
                break
            _move(jacobian, error, rows, damping, gram, q, b, limits)


@compiled
def track(
    chain: Floats, limits: Floats, ee_m: Floats, q: Floats, goals: Floats, weights_m: Floats,
    steps: int,
) -> None:  # fmt: skip
    """Moves arm poses (B, J) to end-effector poses (B, 12), as `BatchArm.track_poses`."""
    joints, jacobian, gram, error = (
        np.zeros((len(chain) + 2, 12)),
        np.empty((6, len(chain))),
        np.empty((6, 6)),
        np.empty(6),
    )
    joints[0, 0] = joints[0, 4] = joints[0, 8] = 1.0
    for b in range(len(q)):
        for _ in range(steps):
            kinematics(chain, q, b, joints)
            point = out_of(joints, len(chain), ee_m[0], ee_m[1], ee_m[2])
            _jacobian(chain, joints, point, jacobian)
            for i in range(3):
                error[i] = goals[b, 9 + i] - point[i]
            _turn(joints, goals, b, weights_m[b], error)
            for i in range(3, 6):
                for j in range(jacobian.shape[1]):
                    jacobian[i, j] *= weights_m[b]
            _move(jacobian, error, 6, DAMPING_OF_TRACKING, gram, q, b, limits)


@inlined
def _turn(joints: Floats, goals: Floats, b: int, weight_m: float, error: Floats) -> None:
    """Writes the weighted rotation from the wrist to a goal: the logarithm of goal wrist^T."""
    wrist, trace, x, y, z = len(joints) - 2, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        gx, gy, gz = goals[b, k], goals[b, 3 + k], goals[b, 6 + k]
        wx, wy, wz = joints[wrist, k], joints[wrist, 3 + k], joints[wrist, 6 + k]
        trace += gx * wx + gy * wy + gz * wz
        x += gz * wy - gy * wz
        y += gx * wz - gz * wx
        z += gy * wx - gx * wy
    angle = acos(min(1.0, max(-1.0, 0.5 * (trace - 1.0))))
    # Without a turn, angle / sin(angle) is its limit 1.
    half = 0.5 if angle < 1e-6 else 0.5 * angle / max(sin(angle), 1e-9)
    error[3], error[4], error[5] = weight_m * half * x, weight_m * half * y, weight_m * half * z


@compiled
def positions(chain: Floats, ee_m: Floats, q: Floats, out: Floats) -> None:
    """Writes the end-effector's positions (B, 3) at arm poses (B, J)."""
    joints = np.zeros((len(chain) + 2, 12))
    joints[0, 0] = joints[0, 4] = joints[0, 8] = 1.0
    for b in range(len(q)):
        kinematics(chain, q, b, joints)
        out[b, 0], out[b, 1], out[b, 2] = out_of(joints, len(chain), ee_m[0], ee_m[1], ee_m[2])
