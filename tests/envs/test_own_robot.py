"""A robot of a user: a telescopic arm of boxes, in a URDF and a module, played by a planner."""

from dataclasses import replace

import gymnasium as gym
import pytest
from hab_eval.cli import main
from hab_eval.records.results import read_record

from hab_tasks.errors import DatasetError, OptionError
from hab_tasks.robots.spec import robot_of

BOX = '<{part}><origin xyz="{at}"/><geometry><box size="{size}"/></geometry></{part}>'
INERTIAL = '<inertial><mass value="{kg}"/><inertia {moments}/></inertial>'
MOMENTS = 'ixx="0.003" ixy="0" ixz="0" iyy="0.003" iyz="0" izz="0.003"'
LINKS = """
root 1
x_link 1
y_link 1
base_link 40 0,0,0.2 0.36,0.34,0.40
lift_link 1 0,0,0 0.10,0.10,0.10
shoulder_link 0.5 0.05,0,0 0.20,0.08,0.06
telescope_link 0.3 -0.18,0,0 0.36,0.04,0.04
yaw_link 0.1
hand_link 0.2 0.08,0,0 0.06,0.12,0.04
left_link 0.05 0,0,0 0.06,0.01,0.02
right_link 0.05 0,0,0 0.06,0.01,0.02
"""
"""Name, mass [kg], position [m] and size [m] of its box."""

JOINTS = """
x prismatic root x_link 0,0,0 1,0,0 -20,20
y prismatic x_link y_link 0,0,0 0,1,0 -20,20
turn continuous y_link base_link 0,0,0 0,0,1 -9,9
lift prismatic base_link lift_link 0.1,0,0 0,0,1 0.3,1.5
pan revolute lift_link shoulder_link 0,0,0.1 0,0,1 -1.6,1.6
telescope prismatic shoulder_link telescope_link 0.35,0,0 1,0,0 0,0.6
wrist_yaw revolute telescope_link yaw_link 0,0,0 0,0,1 -1.8,1.8
wrist_pitch revolute yaw_link hand_link 0,0,0 0,1,0 -0.5,1.7
left prismatic hand_link left_link 0.14,0,0 0,1,0 0,0.05
right prismatic hand_link right_link 0.14,0,0 0,-1,0 0,0.05
"""
"""Name, kind, parent, child, position [m], axis, limits [m or rad]."""

MODULE = """
from pathlib import Path

from mani_skill.agents.registration import register_agent

from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.robots.spec import CameraPlace, RobotSpec, register_robot

TELE = RobotSpec(
    uid="tele",
    urdf=str(Path(__file__).with_name("tele.urdf")),
    arm_joints=("lift", "pan", "telescope", "wrist_yaw", "wrist_pitch"),
    arm_links=("lift_link", "shoulder_link", "telescope_link", "yaw_link", "hand_link"),
    arm_lower_rad=(0.3, -1.6, 0.0, -1.8, -0.5),
    arm_upper_rad=(1.5, 1.6, 0.6, 1.8, 1.7),
    elbow_joint="telescope",
    shoulder_m=(0.1, 0.0, 0.9),
    rest_position_m=(0.6, 0.0, 0.9),
    rest_qpos_rad=(1.0, 0.0, 0.15, 0.0, 1.5707963),
    locked_qpos={"left": 0.04, "right": 0.04},
    lift_joint=None,
    base_joints=("x", "y", "turn"),
    base_link="base_link",
    base_height_m=0.005,
    base_linear_speed_m_s=1.0,
    base_angular_speed_rad_s=3.14,
    body_links=("base_link",),
    finger_links=("left_link", "right_link"),
    ee_link="hand_link",
    ee_offset_m=0.2,
    ee_lower_m=(0.4, -0.7, 0.25),
    ee_upper_m=(1.0, 0.7, 1.4),
    cameras={
        "head": CameraPlace(link="base_link", position_m=(0, 0.2, 1.3), target_m=(1, 0, 0.7)),
        "arm": CameraPlace(link="hand_link", position_m=(0.1, 0, 0.1)),
    },
)
register_robot(TELE, f"{__name__}:Tele")


@register_agent()
class Tele(MobileManipulator):
    spec = TELE
    uid = "tele"
"""


def urdf():
    parts = []
    for name, kg, *box in map(str.split, LINKS.split("\n")[1:-1]):
        parts += [f'<link name="{name}">', INERTIAL.format(kg=kg, moments=MOMENTS)]
        at, size = (one.replace(",", " ") for one in box) if box else ("", "")
        parts += [BOX.format(part=p, at=at, size=size) for p in ("visual", "collision") if box]
        parts.append("</link>")
    for name, kind, parent, child, at, axis, limits in map(str.split, JOINTS.split("\n")[1:-1]):
        low, high = limits.split(",")
        parts += [f'<joint name="{name}" type="{kind}"><origin xyz="{at.replace(",", " ")}"/>']
        parts += [f'<parent link="{parent}"/><child link="{child}"/>']
        parts += [f'<axis xyz="{axis.replace(",", " ")}"/><dynamics damping="1"/>']
        parts += [f'<limit lower="{low}" upper="{high}" effort="200" velocity="2"/></joint>']
    return f'<robot name="tele">{"".join(parts)}</robot>'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a robot in two files, which processes find."""
    folder = tmp_path_factory.mktemp("tele")
    (folder / "tele.urdf").write_text(urdf())
    (folder / "tele.py").write_text(MODULE)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        patch.setenv("PYTHONPATH", str(folder))
        yield folder


@pytest.mark.slow
def test_a_planner_picks_with_it_in_other_processes(folder):
    out = folder / "run"
    command = "run --agent hab_spa:spa_priv --option planner=batched --env HabPick-v1 --split val"
    command += f" --episodes 4 --workers 2 --env-option robot=tele:tele --out {out}"
    assert main(command.split()) == 0
    record = read_record(out / "run.json")
    assert sum(one.success for one in record.episodes) >= 3


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
def test_it_has_its_own_rest_position_camera_and_starts():
    options = {"obs_mode": "depth", "cameras": ["head"], "split": "val", "num_episodes": 3}
    env = gym.make("HabPick-v1", robot="tele:tele", **options)
    for index in range(3):
        obs, _ = env.reset(seed=0, options={"episode": index})
        assert obs["sensor_data"]["head"]["depth"].float().std() > 0.01
        assert obs["agent"]["rest_from_ee"].abs().max() < 0.06  # S H.2: noise of 5 cm
        rest_m = obs["agent"]["ee_position"] + obs["agent"]["rest_from_ee"]
        assert rest_m[0].tolist() == pytest.approx([0.6, 0.0, 0.9], abs=1e-5)
    env.close()


def test_a_missing_module_is_named():
    with pytest.raises(OptionError, match="robot nothing_here:tele: No module named"):
        robot_of("nothing_here:tele")


def test_a_missing_link_is_named(folder):
    file = folder / "other.urdf"
    file.write_text(urdf().replace('"hand_link"', '"palm_link"'))
    with pytest.raises(DatasetError, match=r"other\.urdf: Unknown link 'hand_link'\."):
        replace(robot_of("tele:tele"), urdf=str(file)).urdf_tree()
