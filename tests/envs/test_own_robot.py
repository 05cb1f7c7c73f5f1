"""A robot of a user in one file: another rest pose and camera, a renamed hand, six arm joints."""

from dataclasses import replace
from xml.etree import ElementTree

import gymnasium as gym
import numpy as np
import pytest
import torch
from hab_eval import straight_line
from hab_spa import spa_priv
from mani_skill.agents.registration import register_agent

from hab_tasks.agent_spaces import agent_setup
from hab_tasks.envs import ENVS
from hab_tasks.robots.fetch import FETCH
from hab_tasks.robots.fetch.agent import HabFetch
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.robots.spec import CameraPlace, register_robot

REST_M = (0.6, 0.1, 0.9)
LOCKED = FETCH.arm_joints.index("forearm_roll_joint")
ARM = ("arm_joints", "arm_links", "arm_lower_rad", "arm_upper_rad", "rest_qpos_rad")
OTHERS = {field: np.delete(getattr(FETCH, field), LOCKED).tolist() for field in ARM}


@register_agent()
class LowFetch(HabFetch):
    uid = "low_fetch"


@pytest.fixture
def low_fetch(tmp_path):
    urdf = ElementTree.tostring(FETCH.urdf_tree(), encoding="unicode")
    for suffix, text in ((".urdf", urdf), (".srdf", FETCH.srdf_path().read_text())):
        (tmp_path / f"low{suffix}").write_text(text.replace('"gripper_link"', '"hand_link"'))
    locked = {**FETCH.locked_qpos, FETCH.arm_joints[LOCKED]: FETCH.rest_qpos_rad[LOCKED]}
    six = replace(FETCH, locked_qpos=locked, **{name: tuple(OTHERS[name]) for name in ARM})
    rest = ArmKinematics(six).approach(np.array(six.rest_qpos_rad), np.array(REST_M), 99, 0.02)
    arm = CameraPlace(link="hand_link", position_m=(0.0, 0.0, 0.1))
    side = CameraPlace(link="base_link", position_m=(0.2, -0.8, 1.5), target_m=(0.8, 0.0, 0.8))
    LowFetch.spec = replace(
        six,
        uid=LowFetch.uid,
        urdf=str(tmp_path / "low.urdf"),
        rest_position_m=REST_M,
        rest_qpos_rad=tuple(rest.tolist()),
        ee_link="hand_link",
        cameras={"arm": arm, "side": side},
    )
    register_robot(LowFetch.spec, f"{__name__}:LowFetch")


@pytest.mark.slow
@pytest.mark.usefixtures("low_fetch")
@pytest.mark.parametrize("factory", [straight_line, spa_priv])
def test_it_plays_pick_from_its_own_starts(factory, monkeypatch):
    with monkeypatch.context() as patch:  # agents plan for the class's robot
        patch.setattr(ENVS["HabPick-v1"].env, "robot", LowFetch.spec)
        agent, won = factory(agent_setup("HabPick-v1")), []
    options = {"obs_mode": "depth", "cameras": ["side"], "control_mode": agent.spec.control_mode}
    options |= {"split": "val", "num_episodes": 3, "robot_uids": LowFetch.uid}
    env = gym.make("HabPick-v1", **options)
    for index in range(3):
        obs, _ = env.reset(seed=0, options={"episode": index})
        assert obs["sensor_data"]["side"]["depth"].float().std() > 0.01
        assert obs["agent"]["rest_from_ee"].abs().max() < 0.06  # S H.2: noise of 5 cm
        agent.reset(torch.tensor([True]), [index])
        over = False
        while not over:
            obs, _, ended, truncated, info = env.step(
                agent.act({**obs, "privileged": env.unwrapped.privileged()})
            )
            over = bool(ended) or bool(truncated)
        won.append(bool(info["success"]))
        hand_m = obs["agent"]["ee_position"] + obs["agent"]["rest_from_ee"]
        assert hand_m[0].tolist() == pytest.approx(REST_M, abs=1e-5)
    env.close()
    assert sum(won) >= 2, won
