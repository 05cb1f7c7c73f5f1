"""The spaces and cameras passed to an agent's factory equal those of the environment."""

import gymnasium as gym
import numpy as np
import pytest
from playing import slow

from hab_tasks.agent import AgentSetup, AgentSpec
from hab_tasks.agent_spaces import agent_setup, agent_spaces
from hab_tasks.envs import ENVS
from hab_tasks.errors import HabError, OptionError, UnknownNameError


@pytest.mark.parametrize(
    "env_id", ["HabPick-v1", "HabNavigate-v1", pytest.param("HabSetTable-v1", marks=slow)]
)
def test_spaces_of_states_and_actions(env_id):
    first = ENVS[env_id].env.control_modes[0]
    for obs_mode in ("state_dict", "state"):
        spec = AgentSpec(name="x", control_mode=first, obs_mode=obs_mode)
        told = agent_setup(env_id).spaces(spec)
        env = gym.make(f"hab_tasks:{env_id}", obs_mode=obs_mode, control_mode=first).unwrapped
        assert told.observation == env.single_observation_space
        assert told.action == env.single_action_space
        assert not told.cameras
        env.close()


@pytest.mark.render
@pytest.mark.parametrize(
    ("env_id", "obs_mode"),
    [
        ("HabNavigate-v1", "depth"),
        pytest.param("HabPick-v1", "rgb+depth+segmentation+position", marks=slow),
    ],
)
def test_spaces_of_images_and_cameras(make, env_id, obs_mode):
    mode = ENVS[env_id].env.control_modes[0]
    told = agent_spaces(env_id, AgentSpec(name="x", control_mode=mode, obs_mode=obs_mode))
    env = make(env_id, obs_mode=obs_mode, control_mode=mode).unwrapped
    assert told.observation == env.single_observation_space
    obs, _ = env.reset(seed=0)
    assert list(told.cameras) == list(obs["sensor_data"])
    for name, camera in told.cameras.items():
        seen = obs["sensor_param"][name]
        np.testing.assert_allclose(camera.intrinsics_px, seen["intrinsic_cv"][0], atol=1e-4)
        # World to camera is the inverse of world from link times link from camera.
        world_from_link = env.agent.link(camera.link).pose.to_transformation_matrix()[0].numpy()
        expected = np.linalg.inv(world_from_link @ camera.link_from_camera)[:3]
        np.testing.assert_allclose(seen["extrinsic_cv"][0], expected, atol=1e-4)
        size = camera.height_px, camera.width_px
        assert obs["sensor_data"][name]["depth"].shape[1:3] == size


def test_what_cannot_be_told_is_refused():
    pick = AgentSpec(name="x", control_mode="ee")
    with pytest.raises(UnknownNameError, match="Did you mean 'HabPick-v1'"):
        agent_spaces("HabPik-v1", pick)
    with pytest.raises(UnknownNameError, match="Did you mean 'ee'"):
        agent_spaces("HabPick-v1", AgentSpec(name="x", control_mode="e"))
    with pytest.raises(OptionError, match="'pointcloud'"):
        agent_spaces("HabPick-v1", AgentSpec(name="x", control_mode="ee", obs_mode="pointcloud"))
    with pytest.raises(HabError, match="agent_setup"):
        AgentSetup(env_id="HabPick-v1").spaces(pick)
