"""Robot specification used by the engine: links, joints, hand, rest pose, base and cameras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from hab_tasks.constants import CONTROL_HZ
from hab_tasks.errors import DatasetError, OptionError, UnknownNameError

Limits = tuple[float, ...]
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


@dataclass(frozen=True, kw_only=True)
class Fingers:
    """Two fingers that close along the y axis of `RobotSpec.ee_link`.

    Attributes:
        joints: Their joints; 0 is closed.
        open_m: Position of each joint when the hand is open; half of the gap between the fingers.
        squeeze_m: Closing fingers are driven so far beyond closed: even thin things are pressed.
        depth_m: Extent of the fingers along the x axis of `ee_link`, lower and upper.
        force_n: Maximum force of each.
        stiffness_n_m: Of their drives.
        damping_n_s_m: Likewise.
        friction: Coefficient of friction of their pads.
    """

    joints: tuple[str, str]
    open_m: float
    depth_m: tuple[float, float]
    squeeze_m: float = 0.03
    force_n: float = 100.0
    stiffness_n_m: float = 1e3
    damping_n_s_m: float = 1e2
    friction: float = 2.0

    @property
    def spans_m(self) -> float:
        """Largest width of what is grasped, with 4 mm between it and each finger."""
        return 2 * self.open_m - 0.008


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotSpec:
    """Specification of a mobile manipulator. Importing one does not load the simulator.

    Attributes:
        uid: ManiSkill's robot uid, and prefix of its link names in the privileged state.
        urdf: The URDF, in ManiSkill's asset folder or absolute.
        base_urdf: Another, in the same way, that adds elements, and replaces those of the same
            name: the base of an arm that has none. An SRDF beside the last of them may have pairs
            of links that are not checked for collision.
        arm_joints: The controlled arm joints, from the shoulder on.
        arm_links: Their child links, in the same order.
        arm_lower_rad: Lower limits, in m for sliding joints; continuous joints are limited to one
            turn.
        arm_upper_rad: Upper limits.
        elbow_joint: The one of them from which on the arm extends beyond the base.
        shoulder_m: About where the arm begins, in the base frame.
        rest_position_m: Resting end-effector in the base frame (E.3).
        rest_qpos_rad: Arm pose with the end-effector there (within 0.1 mm).
        locked_qpos: Joints that the paper does not control -> position [m or rad].
        lift_joint: The one of them that lifts the arm along the base's z axis, None without one.
        base_joints: Joints of x, y and yaw of the base.
        base_link: The link whose frame is the base frame.
        base_height_m: Height of that frame above the floor.
        base_linear_speed_m_s: Maximum linear speed.
        base_angular_speed_rad_s: Maximum angular speed.
        body_links: Links of the base and of what it carries, near which objects are awake.
        finger_links: The links of the gripper's fingers.
        fingers: The fingers, if they grasp by friction; None with the snap grasp (S E.3).
        ee_link: The link that carries the gripper.
        ee_offset_m: Offset of the end-effector point from `ee_link` along its x axis.
        ee_lower_m: Lower corner of the end-effector's workspace box in the base frame.
        ee_upper_m: Upper corner.
        cameras: The sensor cameras by name.
        shapeless_links: Links that collide with nothing.
        tucked_qpos_rad: Arm pose with arm, hand and held object above the base, within 0.35 m of
            its center; empty for the resting pose.
        near_pairs: Link pairs within 2 cm of each other in the resting pose that never touch; the
            engine would check them for contacts in every step.
    """

    uid: str
    urdf: str
    base_urdf: str | None = None
    arm_joints: tuple[str, ...]
    arm_links: tuple[str, ...]
    arm_lower_rad: Limits
    arm_upper_rad: Limits
    elbow_joint: str
    shoulder_m: Point
    rest_position_m: Point
    rest_qpos_rad: tuple[float, ...]
    locked_qpos: Mapping[str, float]
    lift_joint: str | None
    base_joints: tuple[str, str, str]
    base_link: str
    base_height_m: float
    base_linear_speed_m_s: float
    base_angular_speed_rad_s: float
    body_links: tuple[str, ...]
    finger_links: tuple[str, ...]
    fingers: Fingers | None = None
    ee_link: str
    ee_offset_m: float
    ee_lower_m: Point
    ee_upper_m: Point
    cameras: Mapping[str, CameraPlace]
    shapeless_links: tuple[str, ...] = ()
    tucked_qpos_rad: tuple[float, ...] = ()
    near_pairs: tuple[tuple[str, str], ...] = ()

    def __deepcopy__(self, memo: object) -> RobotSpec:
        """Returns itself: ManiSkill copies the configurations of its controllers."""
        return self

    @property
    def finger_joints(self) -> tuple[str, ...]:
        """Joints of fingers that grasp by friction; none with the snap grasp."""
        return () if self.fingers is None else self.fingers.joints

    @property
    def grasp(self) -> str:
        """``snap`` or ``friction``."""
        return "snap" if self.fingers is None else FRICTION

    @property
    def base_step_m(self) -> float:
        """Distance that the base drives in a control step at its maximum speed."""
        return self.base_linear_speed_m_s / CONTROL_HZ

    @property
    def base_step_rad(self) -> float:
        """Angle that it turns in a control step at its maximum speed."""
        return self.base_angular_speed_rad_s / CONTROL_HZ

    def urdf_tree(self) -> ElementTree.Element:
        """Returns the root of its URDF, with absolute paths of meshes.

        Raises:
            DatasetError: The file is missing or damaged, or lacks a link or joint named here.
        """
        root, *added = [_read(file) for file in self._files()]
        named = {(element.tag, element.get("name")): element for element in root}
        for element in (element for base in added for element in base):
            if (old := named.get((element.tag, element.get("name")))) is not None:
                root.remove(old)
            root.append(element)
        for kind, names in self._named().items():
            known = [element.get("name", "") for element in root.findall(kind)]
            for name in (name for name in names if name not in known):
                raise DatasetError(f"{self._files()[-1]}: {UnknownNameError(kind, name, known)}")
        return root

    def srdf_tree(self) -> ElementTree.Element:
        """Returns the root of its SRDF, which is empty if there is none."""
        file = self._files()[-1].with_suffix(".srdf")
        return _read(file) if file.is_file() else ElementTree.Element("robot", name=self.uid)

    def _named(self) -> dict[str, tuple[str, ...]]:
        """Returns the links and joints that its URDF has to have."""
        cameras = tuple(place.link for place in self.cameras.values())
        links = *self.arm_links, self.base_link, *self.body_links, *self.finger_links, self.ee_link
        joints = *self.arm_joints, *self.base_joints, *self.locked_qpos, *self.finger_joints
        return {"link": (*links, *cameras), "joint": joints}

    def _files(self) -> list[Path]:
        import mani_skill  # takes seconds, which would slow down --help

        return [mani_skill.PACKAGE_ASSET_DIR / one for one in (self.urdf, self.base_urdf) if one]


def _read(file: Path) -> ElementTree.Element:
    """Returns the root of a URDF or SRDF, with absolute paths of meshes."""
    try:
        root = ElementTree.parse(file).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise DatasetError(f"{file}: {error}.") from error
    for mesh in root.iter("mesh"):
        mesh.set("filename", str((file.parent / mesh.get("filename", "")).resolve()))
    return root


FRICTION = "friction"

PREFIX = "hab_"
"""Prefix of uids, which ManiSkill's robots do not have."""

_robots: dict[str, tuple[RobotSpec, str]] = {}
"""Uid -> specification, and ``module:Class`` of the agent."""


def register_robot(spec: RobotSpec, agent: str) -> None:
    """Makes a robot known; `agent` is ``module:Class`` of its `MobileManipulator`."""
    _robots[spec.uid] = spec, agent


def robot_of(name: str) -> RobotSpec:
    """Returns the specification of a robot.

    Args:
        name: Its uid, that without ``hab_``, or ``module:uid`` of a module that registers it.

    Raises:
        UnknownNameError: No such robot is registered.
        OptionError: The module cannot be imported.
    """
    module, _, name = name.rpartition(":") if isinstance(name, str) else ("", "", name)
    if module:
        try:
            import_module(module)
        except ImportError as error:
            raise OptionError(f"robot {module}:{name}: {error}. Is it on PYTHONPATH?") from error
    found = _robots.get(name) or _robots.get(f"{PREFIX}{name}")
    if found is None:
        raise UnknownNameError("robot", name, [uid.removeprefix(PREFIX) for uid in _robots])
    return found[0]


def robot_reference(robot: RobotSpec) -> str:
    """Returns a name by which other processes find a robot: its uid, or ``module:uid``."""
    module = _robots[robot.uid][1].partition(":")[0]
    return robot.uid if module.startswith(f"{__package__}.") else f"{module}:{robot.uid}"


def agent_class(spec: RobotSpec) -> Any:
    """Imports and returns the class of a robot's ManiSkill agent."""
    module, _, name = _robots[spec.uid][1].partition(":")
    return getattr(import_module(module), name)


def requested_robot(
    uids: Any, name: str | None, grasp: str | None, default: RobotSpec
) -> RobotSpec:
    """Returns the robot of ManiSkill's option, or of ours, with the grasp of ours.

    Args:
        uids: A uid or, in recorded options, a list of one; None for the default.
        name: Uid or name; has precedence.
        grasp: ``snap`` or ``friction``; None for the robot's own.
        default: The environment's robot.

    Raises:
        UnknownNameError: There is no such robot, or it has no such grasp.
    """
    uid: Any = uids if name is None else name
    if isinstance(uid, list | tuple):
        uid = uid[0] if len(uid) == 1 else tuple(uid)
    robot = with_grasp(default if uid is None else robot_of(uid), grasp)
    agent_class(robot)  # registers it with ManiSkill
    return robot


def with_grasp(robot: RobotSpec, grasp: str | None) -> RobotSpec:
    """Returns a robot with another grasp, which is registered as ``UID_friction``.

    Raises:
        UnknownNameError: It has no such grasp.
    """
    plain = robot.uid.removesuffix(f"_{FRICTION}")
    both = (_robots.get(uid) for uid in (plain, f"{plain}_{FRICTION}"))
    known = {found[0].grasp: found[0] for found in both if found is not None}
    if grasp is None:
        return robot
    if grasp not in known:
        raise UnknownNameError(f"grasp of {robot.uid}", grasp, known)
    return known[grasp]
