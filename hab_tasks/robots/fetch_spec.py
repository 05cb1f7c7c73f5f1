"""Specification of Fetch."""

from __future__ import annotations

from hab_tasks.robots.spec import RobotSpec

_ARM = (
    *("shoulder_pan", "shoulder_lift", "upperarm_roll", "elbow_flex"),
    *("forearm_roll", "wrist_flex", "wrist_roll"),
)

FETCH = RobotSpec(
    uid="hab_fetch",
    urdf="robots/fetch/fetch.urdf",
    arm_joints=tuple(f"{name}_joint" for name in _ARM),
    arm_links=tuple(f"{name}_link" for name in _ARM),
    arm_lower_rad=(-1.6056, -1.221, -3.14159, -2.251, -3.14159, -2.16, -3.14159),
    arm_upper_rad=(1.6056, 1.518, 3.14159, 2.251, 3.14159, 2.16, 3.14159),
    rest_qpos_rad=(-0.4885, -1.15, 0.4776, 0.9086, 0.2447, 2.05, -0.0135),  # gripper downwards
    locked_qpos={  # torso raised 0.15 m, head ahead, fingers open
        "torso_lift_joint": 0.15,
        "head_pan_joint": 0.0,
        "head_tilt_joint": 0.0,
        "l_gripper_finger_joint": 0.04,
        "r_gripper_finger_joint": 0.04,
    },
    base_joints=("root_x_axis_joint", "root_y_axis_joint", "root_z_rotation_joint"),
    base_link="base_link",
    base_height_m=0.005,  # the base's mesh ends at z = 0 and must not rub on the floor
    base_linear_speed_m_s=1.0,
    base_angular_speed_rad_s=3.14,
    finger_joints=("l_gripper_finger_joint", "r_gripper_finger_joint"),
    ee_link="gripper_link",
    ee_offset_m=0.08,  # 5 cm beyond the fingers
    ee_lower_m=(0.4, -0.7, 0.25),
    ee_upper_m=(1.2, 0.7, 1.5),
)
