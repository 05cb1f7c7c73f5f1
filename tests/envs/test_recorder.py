"""ManiSkill's `RecordEpisode` over several episodes, and ManiSkill's replay of its files."""

import json
import subprocess
import sys

import gymnasium as gym
import h5py
import numpy as np
import pytest
from builders import same
from mani_skill.trajectory import utils as trajectory_utils
from mani_skill.utils.wrappers import CPUGymWrapper
from mani_skill.utils.wrappers.record import RecordEpisode
from playing import slow

from hab_tasks.envs import ENVS
from hab_tasks.errors import EpisodeError, OptionError

STEPS = 4
REPLAY = (sys.executable, "-m", "mani_skill.trajectory.replay_trajectory", "--traj-path")


def recorded(env, folder, seeds, **options):
    """Plays `STEPS` drawn actions after each reset; returns the episodes that were played."""
    options = {"save_video": False, "trajectory_name": "t", **options}
    recorder, played = RecordEpisode(env, str(folder), **options), []
    recorder.action_space.seed(0)
    for seed in seeds:
        recorder.reset(seed=seed)
        played.append(recorder.unwrapped.episode[0])
        for _ in range(STEPS):
            recorder.step(recorder.action_space.sample())
    recorder.close()
    return played


def told(file):
    return json.loads(file.with_suffix(".json").read_text())


def same_states(file, other, atol, velocity_atol=None):
    """Whether two files hold the same flags, and the same states but for the first one.

    Velocities of objects [m/s, rad/s] may differ by `velocity_atol`, or else by `atol` as well.
    """
    with h5py.File(file) as a, h5py.File(other) as b:
        for name in b:
            assert np.array_equal(a[name]["actions"], b[name]["actions"])
            assert np.array_equal(a[name]["success"], b[name]["success"])
            mine, theirs = (
                trajectory_utils.dict_to_list_of_dicts(f[name]["env_states"])[1:] for f in (a, b)
            )
            assert len(mine) == len(theirs) == STEPS
            for x, y in zip(mine, theirs, strict=True):
                moving = velocities_taken_from(x), velocities_taken_from(y)
                assert same(*moving, atol=velocity_atol or atol), name
                assert same(x, y, atol=atol), name
    return len(told(other)["episodes"])


def velocities_taken_from(state):
    """Object -> its velocities (6,), which the state, of poses and velocities (13,), then lacks."""
    taken = {name: entry[7:] for name, entry in state["actors"].items()}
    state["actors"] = {name: entry[:7] for name, entry in state["actors"].items()}
    return taken


def replayed(file, *options):
    """The file that ManiSkill's tool writes, in a process that knows nothing of hab_tasks."""
    before = set(file.parent.glob("*.h5"))
    command = [*REPLAY, str(file), "--save-traj", "--allow-failure", *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]
    (made,) = set(file.parent.glob("*.h5")) - before
    return made


# Recording -------------------------------------------------------------------------------------


def test_episodes_follow_one_another_over_layouts(make, tmp_path):
    env_id = "HabSetTable-v1"
    played = recorded(make(env_id), tmp_path, [0, None, None, 1])
    assert len({(e.scene_id, frozenset(e.objects)) for e in played}) > 1
    data = told(tmp_path / "t.h5")
    assert data["env_info"]["env_id"] == f"hab_tasks:{env_id}"
    assert data["env_info"]["max_episode_steps"] == ENVS[env_id].horizon_steps
    with h5py.File(tmp_path / "t.h5") as file:
        assert list(file) == ["traj_0", "traj_1", "traj_2", "traj_3"]
        for entry, episode in zip(data["episodes"], played, strict=True):
            states = file[f"traj_{entry['episode_id']}/env_states"]
            assert len(file[f"traj_{entry['episode_id']}/actions"]) == STEPS
            assert set(episode.objects) <= set(states["actors"])
            assert all(len(states["actors"][name]) == STEPS + 1 for name in states["actors"])


def test_the_recorded_seed_starts_the_same_episode(make, tmp_path):
    played = recorded(make(), tmp_path, [3, None, None, None])
    env = make()
    for entry, episode in zip(told(tmp_path / "t.h5")["episodes"], played, strict=True):
        env.reset(seed=entry["episode_seed"])
        assert env.unwrapped.episode[0].id == episode.id


def test_states_tell_when_their_entries_change(make):
    env = make()
    assert env.reset(options={"episode": 0})[1]["reconfigure"]
    assert not env.reset(options={"episode": 0})[1]["reconfigure"]
    first, second = (env.unwrapped._simulation.source.get(number) for number in (0, 1))
    assert (first.scene_id, set(first.objects)) != (second.scene_id, set(second.objects))
    assert env.reset(options={"episode": 1})[1]["reconfigure"]


def test_a_state_of_other_objects_is_refused(make):
    env = make()
    env.reset(options={"episode": 0})
    state = env.unwrapped.get_state_dict()
    env.reset(options={"episode": 1})
    with pytest.raises(EpisodeError, match="Start the episode of the state first"):
        env.unwrapped.set_state_dict(state)


def test_every_entry_of_a_state_has_columns(make):
    env = make("HabSetTable-v1")
    env.reset(seed=0)

    def leaves(value):
        return (
            [leaf for part in value.values() for leaf in leaves(part)]
            if isinstance(value, dict)
            else [value]
        )

    assert {leaf.shape[0] for leaf in leaves(env.unwrapped.get_state_dict())} == {1}
    assert min(leaf.dim() for leaf in leaves(env.unwrapped.get_state_dict())) == 2


def test_a_reset_of_row_0_is_recorded_like_a_whole_one(make, tmp_path):
    recorder = RecordEpisode(make(), str(tmp_path), trajectory_name="t", save_video=False)
    for number in (0, 1):
        recorder.reset(options={"env_idx": np.array([0]), "episode": number})
        recorder.step(recorder.action_space.sample())
    recorder.close()
    entries = told(tmp_path / "t.h5")["episodes"]
    assert [entry["reset_kwargs"]["options"]["episode"] for entry in entries] == [0, 1]


def test_plain_arrays_are_recorded_as_well(make, tmp_path):
    recorded(CPUGymWrapper(make(obs_mode="state")), tmp_path, [0, None])
    with h5py.File(tmp_path / "t.h5") as file:
        assert file["traj_1/obs"].shape == (
            STEPS + 1,
            make(obs_mode="state").observation_space.shape[1],
        )


@pytest.mark.slow
@pytest.mark.render
def test_images_and_videos_are_recorded(make, tmp_path):
    env = make(obs_mode="rgb+depth", render_mode="rgb_array", camera_size_px=16)
    recorded(env, tmp_path, [0, None], save_video=True)
    assert sorted(path.name for path in tmp_path.glob("*.mp4")) == ["0.mp4", "1.mp4"]
    with h5py.File(tmp_path / "t.h5") as file:
        for name in ("traj_0", "traj_1"):
            for camera in ("head", "arm"):
                seen = file[f"{name}/obs/sensor_data/{camera}"]
                assert seen["rgb"].shape == (STEPS + 1, 16, 16, 3)
                assert seen["depth"].shape == (STEPS + 1, 16, 16, 1)


# Replay ----------------------------------------------------------------------------------------


@slow
@pytest.mark.render
@pytest.mark.parametrize(
    ("env_id", "options", "atol"),
    [
        ("HabPick-v1", ("--use-env-states", "-o", "rgb+depth"), 1e-2),
        ("HabNavigate-v1", ("--use-first-env-state", "-o", "state_dict"), 1e-5),
        ("HabSetTable-v1", ("-o", "state", "-c", "same", "--count", "2"), 1e-5),
    ],
)
def test_maniskills_tool_replays_it_to_the_same_states(env_id, options, atol, tmp_path):
    """To within `atol`."""
    recorded(gym.make(env_id), tmp_path, [0, None, None])
    mode = told(tmp_path / "t.h5")["episodes"][0]["control_mode"]
    options = [mode if option == "same" else option for option in options]
    made = replayed(tmp_path / "t.h5", *options)
    assert same_states(tmp_path / "t.h5", made, atol) == (2 if "--count" in options else 3)
    if "rgb+depth" in options:
        with h5py.File(made) as file:
            assert sorted(file["traj_1/obs/sensor_data/head"]) == ["depth", "rgb"]


@slow
@pytest.mark.assets
def test_recordings_of_the_real_rooms_replay(replica_cad, ycb, tmp_path):
    env = gym.make("HabPlace-v1", scene_dataset=str(replica_cad), objects=str(ycb))
    recorded(env, tmp_path, [0, None, None])
    made = replayed(tmp_path / "t.h5", "--use-env-states", "-o", "state")
    # A state holds no contact forces of the step before: where a can tumbles at 2.1 rad/s, its
    # velocity after the next step differs by 0.16 rad/s.
    assert same_states(tmp_path / "t.h5", made, 1e-2, velocity_atol=0.3) == 3


# More than one row -----------------------------------------------------------------------------


def test_rows_that_cannot_be_simulated_are_refused_with_advice(monkeypatch):
    monkeypatch.setattr("hab_tasks.engine.simulation.has_gpu", lambda: False)
    for options, words in (
        ({"num_envs": 2}, "num_envs is 2; it has to be 1 on this machine"),
        ({"num_envs": 2, "sim_backend": "physx_cpu"}, "num_envs is 2; it has to be 1 with"),
        (
            {"sim_backend": "physx_cuda:0"},
            "sim_backend is 'physx_cuda:0'; it has to be 'physx_cpu'",
        ),
    ):
        with pytest.raises(OptionError) as caught:
            gym.make("HabPick-v1", **options)
        assert words in str(caught.value)
        assert "gymnasium.make_vec('hab_tasks:HabPick-v1', num_envs=N)" in str(caught.value)


def test_gymnasiums_own_vector_env_plays_what_one_env_plays(make, episode_files):
    """`test_wrappers.py` does so in processes."""
    mode = {"vectorization_mode": "sync"}
    options = {"obs_mode": "state", "episodes": str(episode_files["HabPick-v1"])}
    pair = gym.make_vec("HabPick-v1", num_envs=2, wrappers=[CPUGymWrapper], **mode, **options)
    single = CPUGymWrapper(make(**options))
    action = np.zeros((2, *single.action_space.shape), dtype=np.float32)
    begun, _ = pair.reset(seed=[3, 4])
    after, reward, *_ = pair.step(action)
    pair.close()
    for row, seed in enumerate((3, 4)):
        assert np.array_equal(begun[row], single.reset(seed=seed)[0])
        obs, paid, *_ = single.step(action[row])
        assert np.array_equal(after[row], obs)
        assert reward[row] == paid
