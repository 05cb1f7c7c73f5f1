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
from playing import actions, slow

from hab_tasks.engine import image_source
from hab_tasks.errors import OptionError
from hab_tasks.raycast.compiled import kernel
from hab_tasks.robots.cameras import PLACES

EVERY_CAMERA = tuple(PLACES)


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


def opens_no_graphics(env):
    return not env.unwrapped.scene.can_render()


# The images --------------------------------------------------------------------------------------


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
    rays, renderer = (
        make("HabPlace-v1", obs_mode="depth", render_backend=backend, **options)
        for backend in ("rays", "cpu")
    )
    for seed in (1, 2):
        mine, theirs = played(rays, seed), played(renderer, seed)
        assert_agrees(depth_m(mine), depth_m(theirs))
        for name, parameters in theirs["sensor_param"].items():
            for key, matrix in parameters.items():
                ours = mine["sensor_param"][name][key]
                assert ours.dtype == matrix.dtype
                assert torch.allclose(ours, matrix, atol=1e-5), key
    assert rays.observation_space == renderer.observation_space
    assert opens_no_graphics(rays)


@slow
@pytest.mark.assets
@pytest.mark.render
@pytest.mark.parametrize(
    "scene", ["v3_sc1_staging_10", pytest.param("apt_0", marks=pytest.mark.long)]
)
def test_rays_agree_with_the_renderer_in_replica_cad(data, scene):
    """Its materials are two-sided."""
    images = []
    for backend in ("rays", "cpu"):
        env = gym.make(
            "hab_tasks:HabPlace-v1",
            scene_dataset=data / "replica_cad",
            objects=data / "ycb",
            scene=scene,
            num_episodes=2,
            obs_mode="depth",
            render_backend=backend,
        )
        images.append([depth_m(played(env, seed)) for seed in (1, 2)])
        env.close()
    for mine, theirs in zip(*images, strict=True):
        assert_agrees(mine, theirs, far_off=0.002)


@pytest.mark.render
def test_positions_and_segments_are_those_of_the_renderer(make):
    rays, renderer = (
        make("HabPlace-v1", obs_mode="depth+position+segmentation", render_backend=backend)
        for backend in ("rays", "cpu")
    )
    mine, theirs = (played(env, 1)["sensor_data"] for env in (rays, renderer))
    for name, images in theirs.items():
        ours = mine[name]
        assert {k: (x.shape, x.dtype) for k, x in ours.items()} == {
            k: (x.shape, x.dtype) for k, x in images.items()
        }
        apart_mm = (ours["position"].int() - images["position"].int()).abs()
        assert (apart_mm > 10).float().mean() < 0.01
        assert (ours["segmentation"] != images["segmentation"]).float().mean() < 0.01
        robot = {
            link.name: link._objs[0].entity.per_scene_id
            for link in rays.unwrapped.agent.robot.links
        }
        if name == "head":
            assert robot["gripper_link"] in ours["segmentation"]


@pytest.mark.render
def test_point_clouds_have_no_colour(make):
    rays, renderer = (
        make(obs_mode="pointcloud", render_backend=backend) for backend in ("rays", "cpu")
    )
    mine, theirs = (played(env, 1)["pointcloud"] for env in (rays, renderer))
    assert set(theirs) - set(mine) == {"rgb"}
    apart_m = (mine["xyzw"] - theirs["xyzw"]).abs().amax(dim=2)
    assert apart_m.median() < 0.002
    assert (apart_m > 0.02).float().mean() < 0.01


# A pure function of the state --------------------------------------------------------------------


@pytest.mark.new_env
def test_the_same_state_gives_the_same_image_whatever_came_before(make):
    """Restored states; the engine's own differ from them by rounding."""
    env, other = (make(obs_mode="depth", render_backend="rays") for _ in range(2))
    played(env, 1)
    state = env.unwrapped.get_state_dict()
    looks = []
    for history in (lambda: None, lambda: played(env, 1, 6), lambda: played(env, 2)):
        history()
        env.reset(seed=1)
        env.unwrapped.set_state_dict(state)
        looks.append(env.unwrapped.look()["sensor_data"])
    other.reset(seed=1)
    other.unwrapped.set_state_dict(state)
    looks.append(other.unwrapped.look()["sensor_data"])
    for name, images in looks[0].items():
        for look in looks[1:]:
            assert torch.equal(images["depth"], look[name]["depth"]), name


def test_the_kernel_is_compiled_once(make):
    """For one combination of array types; each takes seconds."""
    make(obs_mode="depth", render_backend="rays").reset(seed=1)
    make(obs_mode="depth+segmentation", render_backend="rays").reset(seed=1)
    assert len(kernel().cast.signatures) == 1


# The option --------------------------------------------------------------------------------------


def test_depth_is_cast_by_default(make):
    env = make(obs_mode="depth")
    assert env.unwrapped._rays is not None
    assert opens_no_graphics(env)
    assert make(obs_mode="state_dict+depth", camera_size_px=16).unwrapped._rays is not None
    assert make(obs_mode="state").unwrapped._rays is None


AUTO = (
    (False, {"obs_mode": "depth"}, ("none", True)),
    (False, {"obs_mode": "depth", "render_mode": "sensors"}, ("none", True)),
    (False, {"obs_mode": "depth", "render_mode": "rgb_array"}, ("cpu", True)),
    (False, {"obs_mode": "rgb+depth"}, ("cpu", False)),
    (False, {"obs_mode": "pointcloud"}, ("cpu", False)),
    (False, {"obs_mode": "depth", "sensor_configs": {"shader_pack": "default"}}, ("cpu", False)),
    (False, {"obs_mode": "state"}, ("none", False)),
    (False, {"obs_mode": "state", "render_mode": "human"}, ("cpu", False)),
    (True, {"obs_mode": "depth"}, ("none", True)),
    (True, {"obs_mode": "depth", "num_envs": 2}, ("gpu", False)),
    (True, {"obs_mode": "depth", "render_mode": "rgb_array"}, ("gpu", True)),
    (True, {"obs_mode": "rgb+depth"}, ("gpu", False)),
)
"""Whether a GPU renders, options, and the renderer and whether rays are cast."""


def test_auto_renders_only_what_rays_cannot_see(monkeypatch):
    monkeypatch.setattr("hab_tasks.rendering.software_vulkan_works", lambda: True)
    wrong = []
    for gpu, options, expected in AUTO:
        monkeypatch.setattr("hab_tasks.rendering.gpu_renders", lambda found=gpu: found)
        source = image_source.choose_source("auto", options)
        if (source.renderer, source.casts_rays) != expected:
            wrong.append((gpu, options, source))
    assert wrong == []


def test_rays_refuse_what_only_a_renderer_delivers(make):
    shader = {"obs_mode": "depth", "sensor_configs": {"head": {"shader_pack": "rt"}}}
    gpu = {"obs_mode": "depth", "sim_backend": "physx_cuda"}
    for options, words in (
        ({"obs_mode": "rgb"}, "obs_mode='rgb', which needs a renderer"),
        ({"obs_mode": "rgb+depth"}, "rays deliver depth, position and segmentation"),
        ({"obs_mode": "depth+normal"}, "which needs a renderer"),
        (shader, "'shader_pack' in sensor_configs"),
    ):
        with pytest.raises(OptionError, match="render_backend is 'rays'") as refused:
            make(render_backend="rays", **options)
        assert words in str(refused.value)
        assert "\n" not in str(refused.value)
    with pytest.raises(OptionError, match="rays are cast on the CPU"):
        image_source.choose_source("rays", gpu)


@pytest.mark.render
@pytest.mark.new_env
def test_a_human_picture_is_rendered_beside_rays(make):
    env, plain = (make(obs_mode="depth", render_mode=mode) for mode in ("rgb_array", None))
    for seed in (1, 2):
        mine, theirs = played(env, seed), played(plain, seed)
        frame = env.render()
        assert frame.shape == (1, 512, 512, 3)
        assert frame.float().std() > 5
        for name, images in theirs["sensor_data"].items():
            assert torch.equal(images["depth"], mine["sensor_data"][name]["depth"])
    assert set(env.unwrapped.render_views()) == {"head", "arm"}


def test_sensors_are_shown_without_a_renderer(make):
    env = make(obs_mode="depth", render_backend="rays", render_mode="sensors")
    env.reset(seed=1)
    assert env.render().shape[-1] == 3
    assert opens_no_graphics(env)


# The process -------------------------------------------------------------------------------------

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


def run(file, **variables):
    done = subprocess.run(
        [sys.executable, "-c", STEPS, str(file)],
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1]), done.stderr


@slow
def test_rays_work_without_drivers_and_with_a_cache_that_is_not_writable(
    episode_files, tmp_path, make
):
    """The kernel is compiled for the run; numba's own folders are not writable either."""
    blocked = tmp_path / "file"
    blocked.write_text("")
    nothing = {name: str(blocked) for name in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES")}
    folders = {"HAB_CACHE_DIR": str(blocked / "cache"), "HOME": str(blocked)}
    found, said = run(episode_files["HabPick-v1"], **nothing, **folders)
    assert found["drivers"] == []
    assert said.count("the cache is not writable") == 1
    env = make(obs_mode="depth", render_backend="rays")
    env.reset(seed=1)
    obs, *_ = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    mean = obs["sensor_data"]["head"]["depth"].mean().item()
    assert found["mean"] == pytest.approx(mean, abs=1e-6)


@slow
def test_a_damaged_kernel_is_compiled_again(episode_files, tmp_path, make):
    env = make(obs_mode="depth", render_backend="rays")
    env.reset(seed=1)
    obs, *_ = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    cache = tmp_path / "cache"
    shutil.copytree(Path(os.environ["HAB_CACHE_DIR"]) / "numba", cache / "numba")
    files = [f for f in (cache / "numba").rglob("*") if f.suffix in (".nbc", ".nbi")]
    assert len(files) == 2
    for file in files:
        file.write_bytes(b"damaged")
    found, said = run(episode_files["HabPick-v1"], HAB_CACHE_DIR=str(cache))
    mean = obs["sensor_data"]["head"]["depth"].mean().item()
    assert found["mean"] == pytest.approx(mean, abs=1e-6)
    assert "damaged cache entry" in said
    assert all(file.read_bytes() != b"damaged" for file in files)
