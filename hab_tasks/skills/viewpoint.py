"""Where the third-person camera stands: over the robot's shoulder, in the same room."""

from __future__ import annotations

import numpy as np
import sapien
from mani_skill.utils.sapien_utils import look_at

from hab_tasks.privileged import Array, PrivilegedState
from hab_tasks.scenes.floor import FreeFloor, free_floor

CAMERA_HEIGHT_M = 1.9
LOOK_AT_M = (0.7, 0.0, 0.75)
CANDIDATES_M = (
    (-0.9, 0.8),
    (-0.9, -0.8),
    (-0.2, 1.2),
    (-0.2, -1.2),
    (0.6, 1.3),
    (0.6, -1.3),
    (-0.45, 0.35),
    (-0.45, -0.35),
)
"""Camera positions in the base frame, best first; the last ones are close to the shoulder."""

_MARGIN_M = 0.1
_SAMPLES = 20


def viewpoint(state: PrivilegedState) -> sapien.Pose:
    """Returns the camera's pose in the base frame for the robot where it stands now."""
    solid = [body for body in state.bodies if body.group in ("stage", "static", "furniture")]
    heights = (1.2, CAMERA_HEIGHT_M + 0.2)
    map_ = free_floor(solid, state.world_from_body, radius_m=0.0, heights_m=heights)
    clear = [min(_clearances(map_, state.world_from_base, p)) for p in CANDIDATES_M]
    free = [i for i, value in enumerate(clear) if value >= _MARGIN_M]
    x, y = CANDIDATES_M[free[0] if free else int(np.argmax(clear))]
    pose = look_at((x, y, CAMERA_HEIGHT_M), LOOK_AT_M)
    return pose.sp


def _clearances(
    map_: FreeFloor, world_from_base: Array, point_m: tuple[float, float]
) -> list[float]:
    """Clearance [m] at points on the way from the robot's middle to `point_m` (base frame)."""
    steps = np.linspace(0.0, 1.0, _SAMPLES)[:, None] * np.array(point_m)
    world = steps @ world_from_base[:2, :2].T + world_from_base[:2, 3]
    return [map_.clearance_at(p) for p in world]
