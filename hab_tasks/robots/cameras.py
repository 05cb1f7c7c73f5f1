"""Sensor cameras on Fetch: on its head, in its hand, and over its shoulder (S 5, F.3)."""

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
from hab_tasks.robots.fetch_spec import ARM_LINKS, EE_LINK

Point = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class CameraPlace:
    """Where a camera sits.

    Attributes:
        link: The link it moves with.
        position_m: In the link's frame.
        target_m: What it looks at, in the link's frame; None: along the link's x.
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
    "arm": CameraPlace(link=EE_LINK, position_m=(0.0, 0.0, 0.1)),
    # Habitat's position: 0.5 m behind, 0.5 m to the left. Habitat aims at (1, -0.75, 0), on the
    # floor to the right, so that what the arm does is at the edge of the picture.
    "third_person": CameraPlace(
        link="base_link", position_m=(-0.5, 0.5, 1.7), target_m=(1.0, 0.0, 0.75)
    ),
}
"""Every sensor camera by name."""


LARGEST_SIZE_PX = 8192


@dataclass(frozen=True, kw_only=True)
class CameraRig:
    """The sensor cameras that a robot carries; square pictures, all alike.

    Attributes:
        names: Which of `PLACES`.
        size_px: Width and height of a picture.
        hfov_rad: Angle that a picture spans, sideways and upwards.
    """

    names: tuple[str, ...] = ("head", "arm")
    size_px: int = CAMERA_SIZE_PX
    hfov_rad: float = CAMERA_HFOV_RAD

    @classmethod
    def of(cls, names: Iterable[str], size_px: int, hfov_rad: float) -> CameraRig:
        """Returns the rig that options ask for.

        Raises:
            UnknownNameError: No such camera.
            OptionError: A size or an angle that no picture has.
        """
        chosen = option_values.names("cameras", names, list(PLACES))
        for name in chosen:
            if name not in PLACES:
                raise UnknownNameError("camera", name, PLACES)
        size_px = option_values.whole("camera_size_px", size_px, 1, LARGEST_SIZE_PX, "pixels")
        valid = "an angle between 0 and pi [rad]"
        if not 0.0 < option_values.number("camera_hfov_rad", hfov_rad, valid) < math.pi:
            raise OptionError("camera_hfov_rad", hfov_rad, valid)
        # In the usual order, and each once.
        return cls(
            names=tuple(n for n in PLACES if n in chosen), size_px=size_px, hfov_rad=hfov_rad
        )

    def configs(self, link: Callable[[str], Link]) -> list[CameraConfig]:
        """Returns ManiSkill's settings of the cameras.

        Args:
            link: Link of the robot by name.
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


class HiddenArm:
    """The arm as what only the human-render camera sees (S F.3); it is there and collides.

    ManiSkill hides and shows its `_hidden_objects` with these two methods, before it draws the
    sensors' pictures and before it draws a person's. On a GPU what was hidden when the renderer
    was set up stays hidden.
    """

    def __init__(self, link: Callable[[str], Link]) -> None:
        """Hides shoulder, arm, gripper and fingers; `link` gives links by name."""
        names = (*ARM_LINKS, EE_LINK, "l_gripper_finger_link", "r_gripper_finger_link")
        self._visuals = [
            component
            for name in names
            for body in link(name)._objs
            for component in body.entity.components
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
