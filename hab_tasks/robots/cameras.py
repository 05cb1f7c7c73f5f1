"""Sensor cameras of Fetch: head, arm and third-person (S 5, F.3)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import sapien
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils.sapien_utils import look_at
from mani_skill.utils.structs import Link

from hab_tasks import option_values
from hab_tasks.constants import CAMERA_DEPTH_MAX_M, CAMERA_HFOV_RAD, CAMERA_SIZE_PX
from hab_tasks.errors import OptionError, UnknownNameError
from hab_tasks.robots.robot import ROBOT
from hab_tasks.simulator import sapien_object

Point = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class CameraPlace:
    """Mount of a camera.

    Attributes:
        link: The link it is mounted on.
        position_m: Position in the link's frame.
        target_m: Look-at point in the link's frame; None to look along the link's x axis.
    """

    link: str
    position_m: Point
    target_m: Point | None = None

    def pose(self) -> sapien.Pose:
        """Returns the camera's pose in the link's frame."""
        if self.target_m is None:
            return sapien.Pose(list(self.position_m))
        return look_at(self.position_m, self.target_m).sp


PLACES = {
    "head": CameraPlace(link="base_link", position_m=(0.17, 0.0, 1.2), target_m=(0.75, 0.0, 1.0)),
    "arm": CameraPlace(link=ROBOT.ee_link, position_m=(0.0, 0.0, 0.1)),
    # Habitat's position: 0.5 m behind, 0.5 m to the left. Habitat looks at (1, -0.75, 0), on the
    # floor to the right, which leaves the arm at the edge of the image.
    "third_person": CameraPlace(
        link="base_link", position_m=(-0.5, 0.5, 1.7), target_m=(1.0, 0.0, 0.75)
    ),
}
"""Sensor cameras by name."""


LARGEST_SIZE_PX = 8192


@dataclass(frozen=True, kw_only=True)
class CameraRig:
    """Sensor cameras of a robot; square images with equal settings.

    Attributes:
        names: Names of cameras in `PLACES`.
        size_px: Image width and height.
        hfov_rad: Field of view, horizontal and vertical.
    """

    names: tuple[str, ...] = ("head", "arm")
    size_px: int = CAMERA_SIZE_PX
    hfov_rad: float = CAMERA_HFOV_RAD

    @classmethod
    def of(cls, names: Iterable[str], size_px: int, hfov_rad: float) -> CameraRig:
        """Returns the rig for the given options.

        Raises:
            UnknownNameError: Unknown camera.
            OptionError: Invalid size or field of view.
        """
        chosen = option_values.names("cameras", names, list(PLACES))
        for name in chosen:
            if name not in PLACES:
                raise UnknownNameError("camera", name, PLACES)
        size_px = option_values.whole("camera_size_px", size_px, 1, LARGEST_SIZE_PX, "pixels")
        valid = "an angle between 0 and pi [rad]"
        if not 0.0 < option_values.number("camera_hfov_rad", hfov_rad, valid) < math.pi:
            raise OptionError.of_value("camera_hfov_rad", hfov_rad, valid)
        # In the order of PLACES, without duplicates.
        return cls(
            names=tuple(n for n in PLACES if n in chosen), size_px=size_px, hfov_rad=hfov_rad
        )

    def configs(self, link: Callable[[str], Link]) -> list[CameraConfig]:
        """Returns ManiSkill's settings of the cameras.

        Args:
            link: Looks up a robot link by name.
        """
        return [
            CameraConfig(
                uid=name,
                pose=PLACES[name].pose(),  # type: ignore[arg-type]
                width=self.size_px,
                height=self.size_px,
                fov=self.hfov_rad,
                near=0.01,
                far=CAMERA_DEPTH_MAX_M,
                mount=link(PLACES[name].link),
            )
            for name in self.names
        ]


def hidden_links() -> tuple[str, ...]:
    """Returns the links that `HiddenArm` hides: shoulder, arm, gripper and fingers."""
    return (*ROBOT.arm_links, ROBOT.ee_link, "l_gripper_finger_link", "r_gripper_finger_link")


class HiddenArm:
    """Hides the arm from all but the human-render camera (S F.3); collisions are unaffected.

    ManiSkill calls `hide_visual` of its `_hidden_objects` before it renders sensors, and
    `show_visual` before it renders for humans. On a GPU, objects that were hidden when the renderer
    was set up stay hidden.
    """

    def __init__(self, link: Callable[[str], Link]) -> None:
        """Hides shoulder, arm, gripper and fingers; `link` looks up a link by name."""
        self._visuals = [
            component
            for name in hidden_links()
            for component in sapien_object(link(name)).entity.components
            if isinstance(component, sapien.render.RenderBodyComponent)
        ]
        self.hide_visual()

    def hide_visual(self) -> None:
        """Hides the arm."""
        for visual in self._visuals:
            visual.visibility = 0.0

    def show_visual(self) -> None:
        """Shows the arm."""
        for visual in self._visuals:
            visual.visibility = 1.0
