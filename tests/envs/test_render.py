"""Images have something in them; needs a Vulkan device."""

import numpy as np
import pytest
import torch

from hab_tasks.envs import ENVS

pytestmark = pytest.mark.render
every_env = pytest.mark.parametrize("env_id", ENVS)
STILL = np.array([0, 0, 0, -1], dtype=np.float32)


@every_env
def test_depth_is_scaled_and_not_constant(make, env_id):
    env = make(env_id, obs_mode="depth", control_mode="ee")
    env.reset(seed=1)
    obs, *_ = env.step(STILL)
    assert set(obs["sensor_data"]) == {"head", "arm"}
    for name, images in obs["sensor_data"].items():
        depth = images["depth"]
        assert depth.shape == (1, 128, 128, 1)
        assert depth.dtype == torch.float32
        assert 0.0 <= depth.min() <= depth.max() <= 1.0
        # 10 m are 1: the flat is 13 m long, and the hand hangs a metre above a table.
        assert depth.min() < 0.3, name
        assert depth.std() > 0.01, name
        for group in env.observation_space["sensor_data"][name].values():
            assert group.contains(depth.numpy())


@every_env
def test_rgb_shows_more_than_black(make, env_id):
    env = make(env_id, obs_mode="rgb", control_mode="ee")
    obs, _ = env.reset(seed=1)
    for name, images in obs["sensor_data"].items():
        rgb = images["rgb"]
        assert rgb.shape == (1, 128, 128, 3)
        assert rgb.dtype == torch.uint8
        assert rgb.float().mean() > 20, name
        assert rgb.float().std() > 5, name


@every_env
def test_the_arm_camera_moves_with_the_arm(make, env_id):
    env = make(env_id, obs_mode="depth", control_mode="ee")
    first = env.reset(seed=1)[0]["sensor_data"]
    for _ in range(10):
        obs, *_ = env.step(np.array([1, 0, -1, -1], dtype=np.float32))
    moved = obs["sensor_data"]["arm"]["depth"] - first["arm"]["depth"]
    assert moved.abs().mean() > 0.005


@every_env
def test_the_third_person_frame_shows_the_robot(make, env_id):
    """Fetch is dark grey, light grey and blue; hiding it changes the picture in its place."""
    env = make(env_id, render_mode="rgb_array")
    env.reset(seed=1)
    frame = env.render()[0].numpy().astype(int)
    assert frame.shape == (512, 512, 3)
    assert frame.mean() > 20
    blue = (frame[..., 2] > frame[..., 0] + 25) & (frame[..., 2] > frame[..., 1] + 5)
    for link in env.unwrapped.agent.robot.links:
        for component in link._objs[0].entity.components:
            if hasattr(component, "visibility"):
                component.visibility = 0.0
    gone = env.render()[0].numpy().astype(int)
    changed = np.abs(frame - gone).sum(axis=2) > 30
    assert 0.02 < changed.mean() < 0.8
    assert (blue & changed).sum() > 50
    middle = changed[128:384, 128:384].mean()
    assert middle > changed.mean(), "the robot is not in the middle of the picture"
