"""Options of the environments: cameras, invisible arm, blindness, noise and delay."""

import json
import math

import numpy as np
import pytest
import sapien
import torch
from builders import same
from mani_skill.utils.wrappers.record import RecordEpisode
from playing import actions, flat, play, record, slow, still

from hab_tasks.engine.noise import SensorNoise
from hab_tasks.envs import ENVS
from hab_tasks.errors import OptionError, UnknownNameError
from hab_tasks.robots.robot import ROBOT

render = pytest.mark.render
ALL = ("head", "arm", "third_person")
NOISE = {"depth_at_1_m_m": 0.01, "rgb_levels": 5.0, "joint_rad": 0.02}


# What is refused -------------------------------------------------------------------------------


def test_a_bad_option_is_refused_with_what_is_valid(make):
    faults = (
        ({"cameras": ["haed"]}, UnknownNameError, "Did you mean 'head'"),
        ({"cameras": []}, OptionError, "some of"),
        ({"camera_size_px": 0}, OptionError, "a whole number of pixels"),
        ({"camera_size_px": 64.0}, OptionError, "a whole number of pixels"),
        ({"camera_hfov_rad": 4.0}, OptionError, "between 0 and pi"),
        ({"camera_hfov_rad": math.nan}, OptionError, "between 0 and pi"),
        ({"camera_hfov_rad": 10**400}, OptionError, "a number of 401 digits.*between 0 and pi"),
        ({"action_delay_steps": -1}, OptionError, "a whole number of steps"),
        ({"sensor_noise": 0.1}, OptionError, "SensorNoise or a dict"),
        ({"sensor_noise": {"deph": 0.1}}, UnknownNameError, "depth_at_1_m_m"),
        ({"camera": ["head"]}, UnknownNameError, "Did you mean 'cameras'"),
    )
    for options, error, words in faults:
        with pytest.raises(error, match=words):
            make(obs_mode="depth", render_backend="none", **options)


# What is felt ----------------------------------------------------------------------------------


@pytest.mark.parametrize("env_id", ["HabOpenFridge-v1", "HabSetTable-v1"])
def test_without_proprioception_the_rest_is_the_same(make, env_id):
    whole = make(env_id, obs_mode="state_dict")
    part = make(env_id, obs_mode="state_dict", proprioception=False)
    entries = [e.name for e in ENVS[env_id].env.observation if not e.proprioceptive]
    for env in (whole, part):
        env.reset(seed=3)
    sequence = actions(whole, 2)
    obs, fewer = whole.step(sequence[0])[0], part.step(sequence[0])[0]
    assert entries
    assert list(fewer) == ["extra"]
    assert list(fewer["extra"]) == entries
    assert same(fewer["extra"], {name: obs["extra"][name] for name in entries})
    assert part.observation_space.contains(
        {k: {n: v.numpy() for n, v in g.items()} for k, g in fewer.items()}
    )


def test_without_proprioception_the_flat_state_is_shorter(make):
    env = make(obs_mode="state", proprioception=False)
    obs, _ = env.reset(seed=0)
    # Pick: only the way to the object's start is left.
    assert obs.shape == (1, 3)
    assert env.observation_space.shape == (1, 3)


@pytest.mark.parametrize(
    ("env_id", "obs_mode"),
    [("HabPick-v1", "state"), ("HabNavigate-v1", "state_dict"), ("HabSetTable-v1", "none")],
)
def test_blind_agents_make_no_renderer(make, monkeypatch, env_id, obs_mode):
    def refuse(*args, **kwargs):
        raise AssertionError("a renderer was made")

    monkeypatch.setattr(sapien.render, "RenderSystem", refuse)
    env = make(env_id, obs_mode=obs_mode, cameras=ALL)
    env.reset(seed=0)
    env.step(still(env))
    base = env.unwrapped
    assert not base.scene.can_render()
    with pytest.raises(RuntimeError, match=r"no system with name \[render\]"):
        _ = base.scene.sub_scenes[0].render_system
    assert not base.scene.sensors
    assert not base.scene.human_render_cameras
    visuals = [
        component
        for entity in base.scene.sub_scenes[0].entities
        for component in entity.components
        if isinstance(
            component, sapien.render.RenderBodyComponent | sapien.render.RenderCameraComponent
        )
    ]
    assert not visuals


# Delay -----------------------------------------------------------------------------------------

MODES = [
    ("HabPick-v1", "joint_target"),
    ("HabNavigate-v1", "base_discrete"),
    ("HabSetTable-v1", "ee_base"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("env_id", "mode"), MODES)
def test_delayed_actions_do_what_they_do_later_without_delay(make, env_id, mode):
    late = make(env_id, control_mode=mode, obs_mode="state_dict", action_delay_steps=3)
    plain = make(env_id, control_mode=mode, obs_mode="state_dict")
    for env in (late, plain):
        env.reset(seed=4)
    idle, sequence = still(plain), actions(plain, 8, gripper=1.0)
    first = record(late, sequence)
    second = record(plain, [idle] * 3 + sequence[:5])
    assert all(same(a, b) for a, b in zip(first, second, strict=True))
    assert not same(first[2]["obs"], first[7]["obs"])


def test_a_reset_forgets_delayed_actions(make):
    late, plain = (make(obs_mode="state_dict", action_delay_steps=n) for n in (2, 0))
    late.reset(seed=1)
    play(late, actions(late, 5))
    for env in (late, plain):
        env.reset(seed=2, options={"reconfigure": True})
    first, second = record(late, actions(late, 2)), record(plain, [still(plain)] * 2)
    assert all(same(a, b) for a, b in zip(first, second, strict=True))


# Noise, and both again -------------------------------------------------------------------------

BOTH = {"sensor_noise": NOISE, "action_delay_steps": 2, "obs_mode": "state_dict"}


def test_two_runs_with_noise_and_delay_are_the_same(make):
    runs = []
    for _ in range(2):
        env = make("HabTidyHouse-v1", **BOTH)
        obs, _ = env.reset(seed=5)
        runs.append([{"obs": obs}, *record(env, actions(env, 12))])
    assert len(runs[0]) == 13
    assert all(same(a, b) for a, b in zip(*runs, strict=True))


def test_an_episode_played_again_has_the_same_noise(make):
    env = make(**BOTH)
    runs = []
    for _ in range(2):
        obs, _ = env.reset(options={"episode": 2, "reconfigure": True})
        runs.append([{"obs": obs}, *record(env, actions(env, 5))])
    assert all(same(a, b) for a, b in zip(*runs, strict=True))


def test_only_the_sensors_are_noisy(make):
    noisy, exact = make(**BOTH), make(**{**BOTH, "sensor_noise": None})
    for env in (noisy, exact):
        env.reset(seed=5)
    sequence = actions(exact, 10)
    first, second = record(noisy, sequence), record(exact, sequence)
    off = torch.cat(
        [
            a["obs"]["agent"]["arm_qpos"] - b["obs"]["agent"]["arm_qpos"]
            for a, b in zip(first, second, strict=True)
        ]
    )
    # 70 draws of 0.02 rad: their spread is known to within 8.5 %, four times of that is a third.
    assert abs(float(off.std()) / 0.02 - 1) < 0.34
    for a, b in zip(first, second, strict=True):
        assert same(a["obs"]["extra"], b["obs"]["extra"])
        assert same(a["measures"], b["measures"])
        assert same(a["coms"], b["coms"])


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


def test_a_recording_names_the_options_and_replays(make, tmp_path):
    env = make(**BOTH, cameras=("head",))
    recorder = RecordEpisode(env, str(tmp_path), save_video=False, trajectory_name="t")
    recorder.reset(seed=5)
    sequence = actions(env, 4)
    told = [recorder.step(action)[0] for action in sequence]
    recorder.flush_trajectory()
    recorder._h5_file.close()
    info = json.loads((tmp_path / "t.json").read_text())["env_info"]
    player = make(info["env_id"], **info["env_kwargs"])
    player.reset(seed=5)
    assert all(same(player.step(a)[0], obs) for a, obs in zip(sequence, told, strict=True))


# What is seen ----------------------------------------------------------------------------------

EVERYTHING = {
    "cameras": ALL,
    "camera_size_px": 32,
    "invisible_arm": True,
    "sensor_noise": SensorNoise(**NOISE),
    "action_delay_steps": 1,
    "proprioception": False,
}
OBS_MODES = ("rgb", "rgbd", "sensor_data", "state+depth")
PLAIN = {"cameras": ALL, "camera_size_px": 32}


@render
@pytest.mark.parametrize(
    ("obs_mode", "options"),
    [
        ("depth", EVERYTHING),
        ("pointcloud", EVERYTHING),
        *(
            pytest.param(mode, PLAIN if number % 2 else EVERYTHING, marks=slow)
            for number, mode in enumerate(OBS_MODES)
        ),
    ],
)
def test_every_observation_mode_works_with_every_option(make, obs_mode, options):
    env = make(obs_mode=obs_mode, **options)
    env.reset(seed=1)
    obs = play(env, actions(env, 3))[-1][0]
    spaces = dict(flat_spaces(env.observation_space))
    for name, value in flat(obs):
        array = value.numpy()
        assert np.isfinite(array).all(), name
        assert spaces[name].contains(array), name
    if obs_mode == "pointcloud":
        assert obs["pointcloud"]["xyzw"].shape == (1, 3 * 32 * 32, 4)
    else:
        assert tuple(obs["sensor_data"]) == ALL
        for images in obs["sensor_data"].values():
            assert all(image.shape[:3] == (1, 32, 32) for image in images.values())
    if "depth" in obs_mode or obs_mode == "rgbd":
        assert all(
            i["depth"].min() >= 0 and i["depth"].max() <= 1 for i in obs["sensor_data"].values()
        )


def flat_spaces(space, name=""):
    if hasattr(space, "spaces"):
        for key, item in space.spaces.items():
            yield from flat_spaces(item, f"{name}/{key}")
    else:
        yield name, space


@render
@pytest.mark.parametrize("cameras", ["arm", ["third_person", "head"]])
def test_any_subset_of_cameras_can_be_had(make, cameras):
    env = make(obs_mode="depth", cameras=cameras, camera_size_px=16)
    obs, _ = env.reset(seed=0)
    asked = {cameras} if isinstance(cameras, str) else set(cameras)
    assert set(obs["sensor_data"]) == asked
    assert set(env.unwrapped.scene.sensors) == asked


@render
def test_size_and_angle_are_those_asked_for(make):
    env = make(
        obs_mode="rgb+depth",
        camera_size_px=48,
        camera_hfov_rad=1.0,
        sensor_configs={"arm": {"width": 20, "height": 30}},
    )
    obs, _ = env.reset(seed=0)
    assert obs["sensor_data"]["head"]["rgb"].shape == (1, 48, 48, 3)
    assert obs["sensor_data"]["arm"]["depth"].shape == (1, 30, 20, 1)
    # f = (48 / 2) / tan(1 / 2) = 43.93 pixels
    intrinsic = obs["sensor_param"]["head"]["intrinsic_cv"][0]
    assert abs(float(intrinsic[0, 0]) - 24 / math.tan(0.5)) < 1e-3
    assert abs(float(intrinsic[1, 1]) - 24 / math.tan(0.5)) < 1e-3


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
    names = (*ROBOT.arm_links, "gripper_link", "l_gripper_finger_link", "r_gripper_finger_link")
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
def test_an_invisible_arm_moves_and_collides_alike(make):
    runs = []
    for invisible in (False, True):
        env = make(obs_mode="rgb", control_mode="ee", invisible_arm=invisible)
        env.reset(seed=1)
        down = [np.array([0, 0, -1, -1], dtype=np.float32)] * 40
        steps = play(env, down)
        runs.append([(s[4]["measures"], s[0]["agent"]) for s in steps])
    assert all(same(a[0], b[0]) and same(a[1], b[1]) for a, b in zip(*runs, strict=True))
    assert float(runs[0][-1][0]["force_total_n"]) > 0


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


@render
def test_a_view_of_all_shows_the_robot_from_where_a_person_sees_it(make):
    """ManiSkill's render mode ``all`` aims the camera too."""
    env = make(obs_mode="rgb", render_mode="all", camera_size_px=512)
    env.reset(seed=1)
    tiles = np.asarray(env.render()[0])
    alone = np.asarray(env.unwrapped.render_rgb_array()[0])
    height, width = alone.shape[:2]
    assert np.array_equal(tiles[:height, :width], alone)
