"""Depth without a renderer: equal to the renderer's, pure, and refused for what it cannot do."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
from builders import same
from playing import actions, long, slow
from refusals import refused_by_call

from hab_tasks.engine.inherited_options import choose_source
from hab_tasks.robots.fetch import FETCH

EVERY_CAMERA = tuple(FETCH.cameras)


def depth_m(obs):
    """Camera -> depth (H, W) [m]; 10 m and beyond are 10 m."""
    return {n: 10.0 * x["depth"][0, :, :, 0].numpy() for n, x in obs["sensor_data"].items()}


def played(env, seed, steps=3):
    """The observation after a few random steps."""
    obs, _ = env.reset(seed=seed)
    for action in actions(env, steps, seed):
        obs, *_ = env.step(action)
    return obs


def assert_agrees(one, other, far_off=0.01):
    """At most 1 mm apart in the median, and in `far_off` of the pixels more than 1 cm."""
    assert set(one) == set(other)
    for name in one:
        apart_m = np.abs(one[name] - other[name])
        assert np.median(apart_m) <= 0.001 + 1e-6, name
        assert (apart_m > 0.01).mean() <= far_off, name


@pytest.mark.render
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"cameras": EVERY_CAMERA, "invisible_arm": True},
        {"camera_size_px": 96, "camera_hfov_rad": 1.0},
        {"sensor_noise": {"depth_at_1_m_m": 0.01}},
        {"sensor_configs": {"near": 0.6, "far": 2.0, "head": {"width": 80, "height": 48}}},
    ],
    ids=["default", "cameras", "size", "noise", "configs"],
)
def test_rays_agree_with_the_renderer(make, options):
    """Place starts with an object in the hand."""
    options = {"obs_mode": "depth", **options}
    rays, renderer = (make("HabPlace-v1", render_backend=b, **options) for b in ("rays", "cpu"))
    for seed in (1, 2):
        mine, theirs = played(rays, seed), played(renderer, seed)
        assert_agrees(depth_m(mine), depth_m(theirs))
        for name, parameters in theirs["sensor_param"].items():
            for key, matrix in parameters.items():
                ours = mine["sensor_param"][name][key]
                assert ours.dtype == matrix.dtype
                assert torch.allclose(ours, matrix, atol=1e-5), key
    assert rays.observation_space == renderer.observation_space
    assert not rays.unwrapped.scene.can_render()


@slow
@pytest.mark.assets
@pytest.mark.render
@pytest.mark.parametrize("scene", ["v3_sc1_staging_10", pytest.param("apt_0", marks=long)])
def test_rays_agree_with_the_renderer_in_replica_cad(data, scene):
    """Its materials are two-sided."""
    real = {"scene_dataset": data / "replica_cad", "objects": data / "ycb", "scene": scene}
    options, images = {"num_episodes": 2, "obs_mode": "depth", **real}, []
    for backend in ("rays", "cpu"):
        env = gym.make("hab_tasks:HabPlace-v1", render_backend=backend, **options)
        images.append([depth_m(played(env, seed)) for seed in (1, 2)])
        env.close()
    for mine, theirs in zip(*images, strict=True):
        assert_agrees(mine, theirs, far_off=0.002)


@pytest.mark.render
def test_positions_segments_and_points_are_those_of_the_renderer(make):
    options = {"obs_mode": "depth+position+segmentation"}
    rays, renderer = (make("HabPlace-v1", render_backend=b, **options) for b in ("rays", "cpu"))
    mine, theirs = (played(env, 1)["sensor_data"] for env in (rays, renderer))
    for name, images in theirs.items():
        ours = mine[name]
        kinds = [{k: (x.shape, x.dtype) for k, x in seen.items()} for seen in (ours, images)]
        assert kinds[0] == kinds[1]
        apart_mm = (ours["position"].int() - images["position"].int()).abs()
        assert (apart_mm > 10).float().mean() < 0.01
        assert (ours["segmentation"] != images["segmentation"]).float().mean() < 0.01
    hand = rays.unwrapped.agent.link("gripper_link")
    assert hand._objs[0].entity.per_scene_id in mine["head"]["segmentation"]
    options = {"obs_mode": "pointcloud"}
    clouds = [played(make(render_backend=b, **options), 1)["pointcloud"] for b in ("rays", "cpu")]
    assert set(clouds[1]) - set(clouds[0]) == {"rgb"}
    apart_m = (clouds[0]["xyzw"] - clouds[1]["xyzw"]).abs().amax(dim=2)
    assert apart_m.median() < 0.002
    assert (apart_m > 0.02).float().mean() < 0.01


@pytest.mark.new_env
def test_the_same_state_gives_the_same_image_whatever_came_before(make):
    """Restored states; the engine's own differ from them by rounding."""
    env, other = (make(obs_mode="depth", render_backend="rays") for _ in range(2))
    played(env, 1)
    state = env.unwrapped.get_state_dict()
    looks = []
    for player, seed, steps in ((env, 1, 0), (env, 1, 6), (env, 2, 3), (other, 1, 0)):
        played(player, seed, steps)
        player.reset(seed=1)
        player.unwrapped.set_state_dict(state)
        looks.append(player.unwrapped.look()["sensor_data"])
    for look in looks[1:]:
        assert same(looks[0], look)


AUTO = (
    (False, {"obs_mode": "depth"}, ("none", True)),
    (False, {"obs_mode": "depth", "render_mode": "sensors"}, ("none", True)),
    (False, {"obs_mode": "depth", "render_mode": "rgb_array"}, ("cpu", True)),
    (False, {"obs_mode": "rgb+depth"}, ("cpu", False)),
    (False, {"obs_mode": "depth", "sensor_configs": {"shader_pack": "default"}}, ("cpu", False)),
    (False, {"obs_mode": "state"}, ("none", False)),
    (False, {"obs_mode": "state", "render_mode": "human"}, ("cpu", False)),
    (True, {"obs_mode": "depth", "render_mode": "rgb_array"}, ("gpu", True)),
)
"""Whether a GPU renders, options, and the renderer and whether rays are cast."""


def test_auto_renders_only_what_rays_cannot_see(monkeypatch):
    monkeypatch.setattr("hab_tasks.rendering.software_vulkan_works", lambda: True)
    for gpu, options, expected in AUTO:
        monkeypatch.setattr("hab_tasks.rendering.gpu_renders", lambda found=gpu: found)
        source = choose_source("auto", options)
        assert (source.renderer, source.casts_rays) == expected, (gpu, options)


def test_rays_refuse_what_only_a_renderer_delivers(make):
    shader = {"obs_mode": "depth", "sensor_configs": {"head": {"shader_pack": "rt"}}}
    for options, words in (
        ({"obs_mode": "rgb"}, "obs_mode='rgb', which needs a renderer"),
        ({"obs_mode": "rgb+depth"}, "rays deliver depth, position and segmentation"),
        (shader, "'shader_pack' in sensor_configs"),
    ):
        refused_by_call(lambda o=options: make(render_backend="rays", **o), words)


STEPS = """
import json, logging, sys
import gymnasium as gym
logging.basicConfig(level=logging.WARNING, stream=sys.stderr)
env = gym.make("hab_tasks:HabPick-v1", obs_mode="depth", episodes=sys.argv[1])
env.reset(seed=1)
obs, *_ = env.step(env.action_space.sample() * 0)
depth = obs["sensor_data"]["head"]["depth"]
maps = open("/proc/self/maps").read()
drivers = [name for name in ("libvulkan_lvp", "vulkan_intel", "vulkan_radeon") if name in maps]
print(json.dumps({"mean": float(depth.mean()), "drivers": drivers}))
"""


@slow
def test_rays_work_without_drivers_and_without_a_cache_that_is_in_order(
    episode_files, tmp_path, make
):
    """The kernel is compiled again where the one in the cache is damaged.

    For the run only, where nothing is writable, numba's own folders neither.
    """
    env = make(obs_mode="depth", render_backend="rays")
    env.reset(seed=1)
    obs, *_ = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    mean = obs["sensor_data"]["head"]["depth"].mean().item()
    cache, blocked = tmp_path / "cache", tmp_path / "file"
    shutil.copytree(Path(os.environ["HAB_CACHE_DIR"]) / "numba", cache / "numba")
    files = [f for f in (cache / "numba").rglob("kernel.cast*") if f.suffix in (".nbc", ".nbi")]
    assert len(files) == 2
    for file in (*files, blocked):
        file.write_bytes(b"damaged")
    for cache_dir, warning in (
        (cache, "damaged cache entry"),
        (blocked / "cache", "the cache is not writable"),
    ):
        drivers = dict.fromkeys(("VK_DRIVER_FILES", "VK_ICD_FILENAMES", "HOME"), str(blocked))
        done = subprocess.run(
            [sys.executable, "-c", STEPS, str(episode_files["HabPick-v1"])],
            env={**os.environ, **drivers, "HAB_CACHE_DIR": str(cache_dir)},
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr[-2000:]
        found = json.loads(done.stdout.splitlines()[-1])
        assert found == {"mean": pytest.approx(mean, abs=1e-6), "drivers": []}
        assert done.stderr.count(warning) == 1
    assert all(file.read_bytes() != b"damaged" for file in files)
