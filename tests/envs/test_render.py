"""Rendered images are not empty; needs a Vulkan device."""

import numpy as np
import pytest
import torch
from builders import ee_action
from playing import slow, still

from hab_tasks.rendering import use_default_shaders

pytestmark = pytest.mark.render
few_envs = pytest.mark.parametrize(
    "env_id",
    ["HabPick-v1", *(pytest.param(e, marks=slow) for e in ("HabNavigate-v1", "HabSetTable-v1"))],
)


def cameras(env_id):
    """Navigate sees with its head only (S H.2)."""
    return {"head"} if env_id == "HabNavigate-v1" else {"head", "arm"}


@pytest.mark.parametrize(
    ("env_id", "backend"),
    [
        ("HabPick-v1", "auto"),
        ("HabPick-v1", "cpu"),
        ("HabNavigate-v1", "auto"),
        pytest.param("HabSetTable-v1", "cpu", marks=slow),
    ],
)
def test_depth_is_scaled_and_not_constant(make, env_id, backend):
    env = make(env_id, obs_mode="depth", render_backend=backend)
    env.reset(seed=1)
    obs, *_ = env.step(still(env))
    assert set(obs["sensor_data"]) == cameras(env_id)
    for name, images in obs["sensor_data"].items():
        depth = images["depth"]
        assert env.observation_space["sensor_data"][name]["depth"].contains(depth.numpy())
        assert depth.shape == (1, 128, 128, 1)
        # 10 m are 1: the flat is 13 m long.
        assert 0.0 <= depth.min() < 0.5, name
        assert depth.max() <= 1.0, name
        assert depth.std() > 0.003, name


@pytest.mark.new_env
@pytest.mark.parametrize("obs_mode", ["depth", pytest.param("rgb+depth", marks=slow)])
def test_depth_is_the_same_whatever_was_rendered_before(make, obs_mode):
    """SAPIEN's picture formats are global: other cameras of the process must not change these."""
    options = {"obs_mode": obs_mode, "render_backend": "cpu"}
    usual = make(**options).reset(seed=1)[0]["sensor_data"]
    use_default_shaders()
    after = make(**options).reset(seed=1)[0]["sensor_data"]
    for name, images in usual.items():
        assert torch.equal(images["depth"], after[name]["depth"]), name


@few_envs
def test_rgb_shows_more_than_black(make, env_id):
    obs, _ = make(env_id, obs_mode="rgb").reset(seed=1)
    assert set(obs["sensor_data"]) == cameras(env_id)
    for name, images in obs["sensor_data"].items():
        rgb = images["rgb"]
        assert (rgb.shape, rgb.dtype) == ((1, 128, 128, 3), torch.uint8)
        assert rgb.float().mean() > 20, name
        assert rgb.float().std() > 5, name


def test_the_arm_camera_moves_with_the_arm(make):
    env = make("HabPick-v1", obs_mode="depth", control_mode="ee")
    first = env.reset(seed=1)[0]["sensor_data"]
    for _ in range(10):
        obs, *_ = env.step(ee_action(env, (1, 0, -1), 0.0))
    moved = obs["sensor_data"]["arm"]["depth"] - first["arm"]["depth"]
    assert moved.abs().mean() > 0.005


@few_envs
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
