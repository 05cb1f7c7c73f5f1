"""Fetch: its specification. Its ManiSkill agent is in `hab_tasks.robots.fetch.agent`."""

from __future__ import annotations

from dataclasses import replace

from hab_tasks.constants import REST_POSITION_M
from hab_tasks.robots.spec import CameraPlace, Fingers, RobotSpec, register_robot

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
    elbow_joint="elbow_flex_joint",
    shoulder_m=(0.033, 0.0, 0.88),
    rest_position_m=REST_POSITION_M,
    rest_qpos_rad=(-0.4885, -1.15, 0.4776, 0.9086, 0.2447, 2.05, -0.0135),  # gripper downwards
    locked_qpos={  # torso raised 0.15 m, head ahead, fingers open
        "torso_lift_joint": 0.15,
        "head_pan_joint": 0.0,
        "head_tilt_joint": 0.0,
        "l_gripper_finger_joint": 0.04,
        "r_gripper_finger_joint": 0.04,
    },
    lift_joint="torso_lift_joint",
    base_joints=("root_x_axis_joint", "root_y_axis_joint", "root_z_rotation_joint"),
    base_link="base_link",
    base_height_m=0.005,  # the base's mesh ends at z = 0 and must not rub on the floor
    base_linear_speed_m_s=1.0,
    base_angular_speed_rad_s=3.14,
    body_links=("torso_lift_link", "base_link"),
    finger_links=("l_gripper_finger_link", "r_gripper_finger_link"),
    ee_link="gripper_link",
    ee_offset_m=0.08,  # 5 cm beyond the fingers
    ee_lower_m=(0.4, -0.7, 0.25),
    ee_upper_m=(1.2, 0.7, 1.5),
    cameras={
        "head": CameraPlace(
            link="base_link", position_m=(0.17, 0.0, 1.2), target_m=(0.75, 0.0, 1.0)
        ),
        "arm": CameraPlace(link="gripper_link", position_m=(0.0, 0.0, 0.1)),
        # Habitat's position: 0.5 m behind, 0.5 m to the left. Habitat looks at (1, -0.75, 0), on
        # the floor to the right, which leaves the arm at the edge of the image.
        "third_person": CameraPlace(
            link="base_link", position_m=(-0.5, 0.5, 1.7), target_m=(1.0, 0.0, 0.75)
        ),
    },
    tucked_qpos_rad=(-1.60, -1.22, 0.90, -0.61, 1.88, 2.14, 0.39),
    # Wheels are inside the base's outline and touch only the floor.
    shapeless_links=("r_wheel_link", "l_wheel_link"),
    near_pairs=(
        ("head_pan_link", "shoulder_lift_link"),  # 1.9 cm or more
        ("head_tilt_link", "shoulder_lift_link"),
    ),
)

_FINGERS = Fingers(
    joints=("l_gripper_finger_joint", "r_gripper_finger_joint"),
    open_m=0.05,
    depth_m=(-0.029, 0.031),
)

FETCH_FRICTION = replace(
    FETCH,
    uid="hab_fetch_friction",
    fingers=_FINGERS,
    rest_qpos_rad=(-0.6778, -1.221, 1.2248, 1.3218, -0.3307, 1.69, 0.4858),  # gripper downwards
    ee_offset_m=0.0,  # between the fingers
    locked_qpos={**FETCH.locked_qpos, **dict.fromkeys(_FINGERS.joints, _FINGERS.open_m)},
)
"""Fetch whose fingers grasp by friction, open at the start."""

register_robot(FETCH, "hab_tasks.robots.fetch.agent:HabFetch")
register_robot(FETCH_FRICTION, "hab_tasks.robots.fetch.agent:HabFetchFriction")
