"""Panda on a mobile base: its specification."""

from __future__ import annotations

from pathlib import Path

from hab_tasks.constants import REST_POSITION_M
from hab_tasks.robots.spec import CameraPlace, RobotSpec, register_robot

_JOINTS = range(1, 8)

PANDA_MOBILE = RobotSpec(
    uid="hab_panda_mobile",
    urdf="robots/panda/panda_v2.urdf",
    base_urdf=str(Path(__file__).with_name("panda_mobile.urdf")),
    arm_joints=tuple(f"panda_joint{n}" for n in _JOINTS),
    arm_links=tuple(f"panda_link{n}" for n in _JOINTS),
    arm_lower_rad=(-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
    arm_upper_rad=(2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
    elbow_joint="panda_joint4",
    shoulder_m=(0.18, 0.0, 0.933),
    rest_position_m=REST_POSITION_M,
    rest_qpos_rad=(0.0, -0.75827, 0.0, -2.40985, 0.0, 1.65158, 0.785398),  # gripper downwards
    locked_qpos={"panda_finger_joint1": 0.03, "panda_finger_joint2": 0.03},
    lift_joint=None,
    base_joints=("root_x_axis_joint", "root_y_axis_joint", "root_z_rotation_joint"),
    base_link="base_link",
    base_height_m=0.005,  # the base must not rub on the floor
    base_linear_speed_m_s=1.0,
    base_angular_speed_rad_s=3.14,
    body_links=("base_link",),
    finger_links=("panda_leftfinger", "panda_rightfinger"),
    ee_link="hand_link",
    ee_offset_m=0.06,  # 5 cm beyond the fingers
    ee_lower_m=(0.4, -0.7, 0.25),
    ee_upper_m=(1.1, 0.7, 1.5),
    cameras={
        "head": CameraPlace(
            link="base_link", position_m=(-0.15, 0.16, 1.4), target_m=(0.75, 0.0, 0.85)
        ),
        "arm": CameraPlace(link="hand_link", position_m=(0.0, 0.0, 0.1)),
        "third_person": CameraPlace(
            link="base_link", position_m=(-0.5, 0.5, 1.7), target_m=(1.0, 0.0, 0.75)
        ),
    },
    tucked_qpos_rad=(0.0, -1.22345, 0.0, -2.30842, 0.0, 1.08497, 0.785398),
)

register_robot(PANDA_MOBILE, "hab_tasks.robots.panda_mobile.agent:HabPandaMobile")
