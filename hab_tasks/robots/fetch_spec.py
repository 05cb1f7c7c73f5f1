"""Facts about Fetch that control, planning and episodes share. No simulator needed to import."""

from __future__ import annotations

from pathlib import Path

ARM_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "upperarm_roll_joint",
    "elbow_flex_joint",
    "forearm_roll_joint",
    "wrist_flex_joint",
    "wrist_roll_joint",
)
ARM_LINKS = tuple(name.replace("_joint", "_link") for name in ARM_JOINTS)
BASE_JOINTS = ("root_x_axis_joint", "root_y_axis_joint", "root_z_rotation_joint")
FINGER_JOINTS = ("l_gripper_finger_joint", "r_gripper_finger_joint")

ARM_LOWER_RAD = (-1.6056, -1.221, -3.14159, -2.251, -3.14159, -2.16, -3.14159)
ARM_UPPER_RAD = (1.6056, 1.518, 3.14159, 2.251, 3.14159, 2.16, 3.14159)
"""Limits of the arm; the three continuous joints are kept within one turn."""

REST_QPOS_RAD = (-0.4885, -1.15, 0.4776, 0.9086, 0.2447, 2.05, -0.0135)
"""Arm pose that puts the end-effector on `REST_POSITION_M` (within 0.1 mm), gripper downwards."""

LOCKED_QPOS = {
    "torso_lift_joint": 0.15,
    "head_pan_joint": 0.0,
    "head_tilt_joint": 0.0,
    "l_gripper_finger_joint": 0.04,
    "r_gripper_finger_joint": 0.04,
}
"""Joints the paper does not control: torso raised 0.15 m, head ahead, fingers open [m or rad]."""

EE_LINK = "gripper_link"
EE_OFFSET_M = 0.08
"""The end-effector point lies this far ahead of `EE_LINK` along its x, 5 cm beyond the fingers."""

EE_LOWER_M = (0.4, -0.7, 0.25)
EE_UPPER_M = (1.2, 0.7, 1.5)
"""Workspace box of the end-effector in the base frame."""

BASE_LINEAR_SPEED_M_S = 1.0
BASE_ANGULAR_SPEED_RAD_S = 3.14


def urdf_path() -> Path:
    """Returns the Fetch URDF of the installed ManiSkill."""
    import mani_skill  # takes seconds, which --help should not

    return Path(mani_skill.PACKAGE_ASSET_DIR) / "robots" / "fetch" / "fetch.urdf"
