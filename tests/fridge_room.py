"""How much room there is before the fridge, for the scripted robot that opens and closes it."""

import math

import numpy as np

from hab_tasks.scenes.floor import free_floor

BASE_FREE_M, HAND_FREE_M = 0.31, 0.13
"""Room that the base and the hand are given where there is as much."""

BASE_HEIGHTS_M, HAND_HEIGHTS_M = (0.06, 1.3), (0.8, 1.3)
"""What lies between these heights is in the way of the base, and of the arm at rest."""

REACHING_OUT = ("elbow_flex_link", "forearm_roll_link", "wrist_flex_link", "gripper_link")


class Room:
    """How much room there is before the fridge as it stands now.

    Attributes:
        arm_m: (4, 3) what reaches out most of the arm as it is now, in the base's frame.
    """

    _low_m, _cell_m, _cells = np.array((0.0, -1.6)), 0.04, (60, 80)

    def __init__(self, env, front: np.ndarray) -> None:
        """Maps it; `front` is x, y, yaw of the fridge's frame."""
        state = env.privileged()[0]
        solid = [body for body in state.bodies if body.group != "robot"]
        poses = state.world_from_body
        base_from_world = np.linalg.inv(state.world_from_base)
        links = [poses[f"hab_fetch/{name}"][:, 3] for name in REACHING_OUT]
        self.arm_m = (np.array(links) @ base_from_world.T)[:, :3]
        self._maps = []
        for heights_m in (BASE_HEIGHTS_M, HAND_HEIGHTS_M):
            bodies = [body for body in solid if body.name in poses]
            floor = free_floor(bodies, poses, radius_m=0.0, heights_m=heights_m)
            points = self._low_m + self._cell_m * np.indices(self._cells).reshape(2, -1).T
            world = points @ turned(front[2]).T + front[:2]
            clear = [floor.clearance_at(point) for point in world]
            self._maps.append(np.array(clear).reshape(self._cells))

    def of_base(self, points_m) -> np.ndarray:
        """Returns how far the nearest body is from floor points (..., 2)."""
        return self._look_up(0, points_m)

    def of_hand(self, points_m) -> np.ndarray:
        """Returns the same at the hand's height."""
        return self._look_up(1, points_m)

    def _look_up(self, number: int, points_m) -> np.ndarray:
        cells = np.round((np.asarray(points_m)[..., :2] - self._low_m) / self._cell_m).astype(int)
        cells = np.clip(cells, 0, np.array(self._maps[number].shape) - 1)
        return self._maps[number][cells[..., 0], cells[..., 1]]

    def lacking_m(self, poses: np.ndarray) -> float:
        """Returns by how much base poses (P, 3) with the arm at rest are short of room."""
        ahead = np.stack((np.cos(poses[:, 2]), np.sin(poses[:, 2])), axis=1)[:, None]
        aside = ahead[..., ::-1] * (-1.0, 1.0)
        arm = poses[:, None, :2] + self.arm_m[:, :1] * ahead + self.arm_m[:, 1:2] * aside
        base = BASE_FREE_M - self.of_base(poses)
        hand = HAND_FREE_M - self.of_hand(arm)
        return float(np.maximum(base, 0.0).max() + np.maximum(hand, 0.0).max())


def turned(angle_rad: float) -> np.ndarray:
    """Returns the matrix (2, 2) of a turn about the vertical."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array(((c, -s), (s, c)))
