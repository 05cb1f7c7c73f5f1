"""Options of the environments: cameras, invisible arm, blindness, noise and delay."""

import math

import numpy as np
import pytest
import sapien
import torch
from builders import same
from mani_skill.utils.wrappers.gymnasium import CPUGymWrapper
from playing import actions, play, record, slow, still

from hab_tasks.engine.noise import SensorNoise
from hab_tasks.engine.sensors import scale_depth
from hab_tasks.envs import ENVS
from hab_tasks.errors import HabError, OptionError, UnknownNameError
from hab_tasks.robots.fetch import FETCH

render = pytest.mark.render
ALL = ("head", "arm", "third_person")
POSE = {"pose": [0.1, 0.0, 0.05, 1.0, 0.0, 0.0, 0.0]}
NOISE = {"depth_at_1_m_m": 0.01, "rgb_levels": 5.0, "joint_rad": 0.02}


def test_a_bad_option_is_refused_with_what_is_valid(make):
    faults = (
        ({"cameras": ["haed"]}, UnknownNameError, "Did you mean 'head'"),
        ({"cameras": []}, OptionError, "some of"),
        ({"camera_size_px": 64.0}, OptionError, "a whole number of pixels"),
        ({"camera_hfov_rad": math.nan}, OptionError, "between 0 and pi"),
        ({"control_mode": "eee"}, UnknownNameError, "Did you mean 'ee'"),
        ({"control_mode": "pd_ee_delta_pose"}, UnknownNameError, "Did you mean 'ee'"),
        ({"control_mode": "pd_joint_pos"}, UnknownNameError, "Did you mean 'joint_target'"),
        ({"control_mode": "pd_joint_vel"}, UnknownNameError, "Did you mean 'joint_delta'"),
        ({"robot": "panda_mobil"}, UnknownNameError, "Did you mean 'panda_mobile'"),
        ({"robot_uids": ("panda", "fetch")}, UnknownNameError, "Valid: fetch"),
        ({"depth": "cm"}, UnknownNameError, "Valid: m, mm"),
        ({"action_delay_steps": -1}, OptionError, "a whole number of steps"),
        ({"sensor_noise": {"deph": 0.1}}, UnknownNameError, "depth_at_1_m_m"),
        ({"perturbation": {"frction": 2.0}}, UnknownNameError, "Did you mean 'friction'"),
        ({"perturbation": {"light": -1.0}}, OptionError, "a number from 0"),
        ({"camera": ["head"]}, UnknownNameError, "Did you mean 'cameras'"),
        *(
            ({"sensor_configs": configs}, error, words)
            for configs, error, words in (
                ([1], OptionError, "a dict"),
                ({"wide": 64}, UnknownNameError, "Did you mean 'width'"),
                ({"arm": {"wide": 64}}, UnknownNameError, "Did you mean 'width'"),
                ({"amr": {"width": 64}}, UnknownNameError, "without a pose 'amr'. Did you mean"),
                ({"own": {"pose": [1, 2, 3]}}, OptionError, "qw"),
                ({"own": POSE | {"mount": "griper_link"}}, UnknownNameError, "'gripper_link'"),
            )
        ),
    )
    for options, error, words in faults:
        with pytest.raises(error, match=words):
            make(obs_mode="depth", render_backend="none", **options)


def test_a_class_that_is_not_registered_is_refused():
    class OwnEnv(ENVS["HabPick-v1"].env):
        """Pick."""

    with pytest.raises(HabError, match=r"call hab_tasks.register_skill\('Own-v1', '.*OwnEnv'"):
        OwnEnv()


@pytest.mark.parametrize("env_id", ["HabOpenFridge-v1", "HabSetTable-v1"])
def test_without_proprioception_the_rest_is_the_same(make, env_id):
    whole = make(env_id, obs_mode="state_dict")
    part = make(env_id, obs_mode="state_dict", proprioception=False)
    entries = [e.name for e in ENVS[env_id].env.observation if not e.proprioceptive]
    for env in (whole, part):
        env.reset(seed=3)
    sequence = actions(whole, 2)
    obs, fewer = whole.step(sequence[0])[0], part.step(sequence[0])[0]
    assert list(fewer) == list(part.observation_space) == ["extra"]
    assert list(fewer["extra"]) == list(part.observation_space["extra"]) == entries != []
    assert same(fewer["extra"], {name: obs["extra"][name] for name in entries})


@pytest.mark.parametrize("obs_mode", ["state", "none"])
def test_blind_agents_make_no_renderer(make, monkeypatch, obs_mode):
    monkeypatch.setattr(sapien.render, "RenderSystem", lambda *_: pytest.fail("a renderer"))
    env = make(obs_mode=obs_mode, cameras=ALL)
    env.reset(seed=0)
    env.step(still(env))
    scene = env.unwrapped.scene
    assert not scene.can_render()
    assert not scene.sensors | scene.human_render_cameras


@slow
@pytest.mark.parametrize(
    ("env_id", "mode"),
    [
        ("HabPick-v1", "joint_target"),
        ("HabNavigate-v1", "base_discrete"),
        ("HabSetTable-v1", "ee_base"),
    ],
)
def test_delayed_actions_do_what_they_do_later_without_delay(make, env_id, mode):
    options = {"control_mode": mode, "obs_mode": "state_dict"}
    late, plain = make(env_id, action_delay_steps=3, **options), make(env_id, **options)
    for env in (late, plain):
        env.reset(seed=4)
    idle, sequence = still(plain), actions(plain, 8, gripper=1.0)
    first = record(late, sequence)
    second = record(plain, [idle] * 3 + sequence[:5])
    assert all(same(a, b) for a, b in zip(first, second, strict=True))
    assert not same(first[2]["obs"], first[7]["obs"])


BOTH = {"sensor_noise": NOISE, "action_delay_steps": 2, "obs_mode": "state_dict"}


def test_only_the_sensors_are_noisy(make):
    noisy, exact = make(**BOTH), make(**{**BOTH, "sensor_noise": None})
    for env in (noisy, exact):
        env.reset(seed=5)
    sequence = actions(exact, 10)
    off = []
    for a, b in zip(record(noisy, sequence), record(exact, sequence), strict=True):
        off.append(a["obs"]["agent"]["arm_qpos"] - b["obs"]["agent"]["arm_qpos"])
        assert same(a["obs"]["extra"], b["obs"]["extra"])
        assert same(a["measures"], b["measures"])
        assert same(a["coms"], b["coms"])
    # 70 draws of 0.02 rad: their spread is known to within 8.5 %, four times of that is a third.
    assert abs(float(torch.cat(off).std()) / 0.02 - 1) < 0.34


def test_a_restored_state_goes_on_with_its_noise_and_its_waiting_actions(make):
    env = make(**BOTH)
    env.reset(seed=5)
    sequence = actions(env, 12)
    record(env, sequence[:6])
    state = env.unwrapped.get_state_dict()
    original = record(env, sequence[6:])
    env.unwrapped.set_state_dict(state)
    again = record(env, sequence[6:])
    for a, b in zip(original, again, strict=True):
        assert same(a["obs"], b["obs"], atol=1e-4)


PLAIN = {"cameras": ALL, "camera_size_px": 32}
EVERYTHING = {
    **PLAIN,
    "invisible_arm": True,
    "sensor_noise": SensorNoise(**NOISE),
    "action_delay_steps": 1,
    "proprioception": False,
}


@render
@pytest.mark.parametrize(
    ("obs_mode", "options"),
    [
        ("depth", EVERYTHING),
        ("pointcloud", EVERYTHING),
        pytest.param("rgb", EVERYTHING, marks=slow),
        pytest.param("rgbd", PLAIN, marks=slow),
        pytest.param("sensor_data", EVERYTHING, marks=slow),
        pytest.param("state+depth", PLAIN, marks=slow),
    ],
)
def test_every_observation_mode_works_with_every_option(make, obs_mode, options):
    env = CPUGymWrapper(make(obs_mode=obs_mode, **options))
    env.reset(seed=1)
    obs = play(env, actions(env, 3))[-1][0]
    assert env.observation_space.contains(obs)
    if obs_mode == "pointcloud":
        assert obs["pointcloud"]["xyzw"].shape == (3 * 32 * 32, 4)
        return
    assert tuple(obs["sensor_data"]) == ALL
    for images in obs["sensor_data"].values():
        assert all(image.shape[:2] == (32, 32) for image in images.values())
        if "depth" in obs_mode or obs_mode == "rgbd":
            assert 0 <= images["depth"].min() <= images["depth"].max() <= 1


@pytest.mark.parametrize("backend", ["rays", pytest.param("cpu", marks=render)])
def test_depth_in_millimetres_is_maniskills(make, backend):
    """1 is 10 m, or nothing seen; with noise of 1 cm at 1 m as well."""
    plain = {"obs_mode": "depth", "render_backend": backend, "sensor_noise": NOISE}
    metres, env = make(**plain), make(**plain, depth="mm")
    expected, obs = (e.reset(seed=1)[0]["sensor_data"] for e in (metres, env))
    for name, images in obs.items():
        depth_mm, space = images["depth"], env.observation_space["sensor_data"][name]["depth"]
        assert (depth_mm.dtype, space.dtype) == (torch.int16, np.int16)
        assert same(scale_depth(depth_mm), expected[name]["depth"])
    assert obs["arm"]["depth"].max() > 1000


@render
def test_cameras_size_and_angle_are_those_asked_for(make):
    wish = {"camera_size_px": 48, "camera_hfov_rad": 1.0}
    wish["sensor_configs"] = {"arm": {"width": 20, "height": 30}}
    env = make(obs_mode="rgb+depth", cameras=["arm", "head"], **wish)
    obs, _ = env.reset(seed=0)
    assert set(obs["sensor_data"]) == set(env.unwrapped.scene.sensors) == {"arm", "head"}
    assert set(make(obs_mode="depth", cameras="arm").reset(seed=0)[0]["sensor_data"]) == {"arm"}
    assert obs["sensor_data"]["head"]["rgb"].shape == (1, 48, 48, 3)
    assert obs["sensor_data"]["arm"]["depth"].shape == (1, 30, 20, 1)
    # f = (48 / 2) / tan(1 / 2) = 43.93 pixels
    intrinsic = obs["sensor_param"]["head"]["intrinsic_cv"][0]
    assert np.allclose(intrinsic.diagonal()[:2], 24 / math.tan(0.5), atol=1e-3)


@render
def test_own_cameras_of_rays_and_renderer_see_the_same(make):
    own = {"world": POSE | {"fov": 1.2}, "wrist": POSE | {"mount": "gripper_link", "width": 30}}
    options = {"obs_mode": "depth", "camera_size_px": 32, "sensor_configs": own}
    envs = [make(render_backend=b, **options) for b in ("rays", "cpu")]
    for env in envs:
        env.reset(seed=0)
    rays, rendered = (env.reset(seed=1)[0] for env in envs)  # another simulation
    assert list(rays["sensor_data"]) == list(rendered["sensor_data"]) == ["head", "arm", *own]
    for name in own:
        pair = [obs["sensor_data"][name]["depth"] for obs in (rays, rendered)]
        assert pair[0].shape == (1, 32, own[name].get("width", 32), 1)
        assert (pair[0] - pair[1]).abs().median() < 1e-3
        matrices = [obs["sensor_param"][name] for obs in (rays, rendered)]
        assert all(torch.allclose(matrices[0][m], matrices[1][m], atol=1e-5) for m in matrices[0])


@render
def test_the_third_person_camera_looks_over_the_shoulder(make):
    env = make(obs_mode="depth", cameras=("third_person",))
    obs, _ = env.reset(seed=0)
    world_from_camera = obs["sensor_param"]["third_person"]["cam2world_gl"][0].numpy()
    base = env.unwrapped.privileged()[0].world_from_base
    pose = np.linalg.inv(base) @ world_from_camera
    assert np.allclose(pose[:3, 3], (-0.5, 0.5, 1.7), atol=1e-4)
    # It looks along its -z, from there to (1, 0, 0.75): (1.5, -0.5, -0.95) / 1.845.
    assert np.allclose(-pose[:3, 2], np.array([1.5, -0.5, -0.95]) / 1.8446, atol=1e-3)


def arm_pixels(env, obs):
    """Camera -> how many of its pixels show shoulder, arm or gripper."""
    links = env.unwrapped.agent.robot.links_map
    names = (*FETCH.arm_links, "gripper_link", "l_gripper_finger_link", "r_gripper_finger_link")
    ids = torch.cat([links[name].per_scene_id for name in names])
    seen = {name: images["segmentation"] for name, images in obs["sensor_data"].items()}
    return {name: int(torch.isin(image, ids).sum()) for name, image in seen.items()}


@render
@pytest.mark.parametrize("obs_mode", ["depth+segmentation", "rgb+segmentation"])
def test_cameras_do_not_see_an_invisible_arm_and_a_person_does(make, obs_mode):
    """With both shaders: the one for depth alone, and ManiSkill's."""
    frames = []
    for invisible in (False, True):
        env = make(obs_mode=obs_mode, cameras=ALL, invisible_arm=invisible, render_mode="rgb_array")
        obs, _ = env.reset(seed=1)
        pixels = arm_pixels(env, obs)
        assert (pixels["head"] > 200 and pixels["third_person"] > 50) != invisible
        assert not invisible or not any(pixels.values())
        frames.append(np.asarray(env.render()[0]))
        # Also after a person has looked.
        assert arm_pixels(env, env.step(still(env))[0]) == pixels or not invisible
    assert np.array_equal(*frames)


@render
def test_noisy_images_are_noisy_and_the_same_again(make):
    pictures = []
    for noise in (NOISE, NOISE, None):
        env = make(obs_mode="rgb+depth", sensor_noise=noise)
        pictures.append(env.reset(seed=1)[0]["sensor_data"])
    assert same(pictures[0], pictures[1])
    for name, exact in pictures[2].items():
        noisy = pictures[0][name]
        colour = (noisy["rgb"].float() - exact["rgb"].float()).std()
        assert 3.0 < colour < 5.5, name
        seen = exact["depth"] < 0.9
        relative = (noisy["depth"] - exact["depth"])[seen] / (10.0 * exact["depth"][seen] ** 2)
        # 1 cm at 1 m is 0.01 of the square of the depth in metres; rounding adds to what is near.
        assert 0.009 < relative[(exact["depth"] > 0.05)[seen]].std() < 0.011, name
