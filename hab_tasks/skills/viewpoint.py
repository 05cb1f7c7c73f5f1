"""Where the human-render camera stands: beside the robot, with no wall between them."""

from __future__ import annotations

import numpy as np
import sapien
from mani_skill.utils.sapien_utils import look_at

from hab_tasks.privileged import Array, PrivilegedState
from hab_tasks.scenes.floor import FreeFloor, free_floor
from hab_tasks.skills.world import World

CAMERA_HEIGHT_M = 2.1
LOOK_AT_M = (0.7, 0.0, 0.75)
CANDIDATES_M = (
    (-1.4, 1.1),
    (-1.4, -1.1),
    (-0.5, 1.7),
    (-0.5, -1.7),
    (0.9, 1.7),
    (0.9, -1.7),
    (-0.9, 0.8),
    (-0.9, -0.8),
    (-0.2, 1.2),
    (-0.2, -1.2),
    (-0.45, 0.35),
    (-0.45, -0.35),
)
"""Camera positions in the base frame, best first; the last ones are close to the shoulder."""

_MARGIN_M = 0.1
_SAMPLES = 20


def _pose(candidate: int) -> sapien.Pose:
    x, y = CANDIDATES_M[candidate]
    return look_at((x, y, CAMERA_HEIGHT_M), LOOK_AT_M).sp


FIRST_VIEW = _pose(0)


class Viewpoint:
    """Chooses the camera's place; it moves with the base until a wall would hide the robot."""

    def __init__(self) -> None:
        self._walls: FreeFloor | None = None
        self._layout, self._episode, self._chosen = "", "", 0

    def follow(self, world: World) -> sapien.Pose | None:
        """Returns the camera's new pose in the base frame; None where it can stay.

        Cheap: a layout's walls are mapped once, and here only the way to the camera is looked at.
        """
        episode = world.episodes[0]
        if self._walls is None or episode.scene_id != self._layout:
            self._walls, self._layout = _walls(world.privileged()[0]), episode.scene_id
        base = np.asarray(world.snapshot.base[0])
        if episode.id == self._episode and _clearance(self._walls, base, self._chosen) > 0.0:
            return None
        self._episode = episode.id
        clear = [_clearance(self._walls, base, i) for i in range(len(CANDIDATES_M))]
        free = [i for i, value in enumerate(clear) if value >= _MARGIN_M]
        self._chosen = free[0] if free else int(np.argmax(clear))
        return _pose(self._chosen)


def _walls(state: PrivilegedState) -> FreeFloor:
    """Maps what reaches up to the camera."""
    solid = [body for body in state.bodies if body.group in ("stage", "static", "furniture")]
    heights = (1.2, CAMERA_HEIGHT_M + 0.2)
    return free_floor(solid, state.world_from_body, radius_m=0.0, heights_m=heights)


def _clearance(walls: FreeFloor, base: Array, candidate: int) -> float:
    """Returns the least clearance [m] on the way from the robot's middle to a camera.

    Args:
        walls: Map of the walls.
        base: (3,) x [m], y [m], yaw [rad].
        candidate: Which of `CANDIDATES_M`.
    """
    x, y = CANDIDATES_M[candidate]
    cosine, sine = np.cos(base[2]), np.sin(base[2])
    reach = np.array((cosine * x - sine * y, sine * x + cosine * y))
    points = base[:2] + np.linspace(0.0, 1.0, _SAMPLES)[:, None] * reach
    return min(walls.clearance_at(point) for point in points)
