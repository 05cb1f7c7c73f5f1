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
from mani_skill.utils.wrappers.record import RecordEpisode
from playing import slow
from refusals import refused_by_call

from hab_tasks.envs import ENVS

STEPS = 4
REPLAY = (sys.executable, "-m", "mani_skill.trajectory.replay_trajectory", "--traj-path")


def recorded(env, folder, seeds):
    """Plays `STEPS` drawn actions after each reset; returns the episodes that were played."""
    recorder = RecordEpisode(env, str(folder), save_video=False, trajectory_name="t")
    played = []
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


def velocities_taken_from(state):
    """Object -> its velocities (6,), which the state, of poses and velocities (13,), then lacks."""
    taken = {name: entry[7:] for name, entry in state["actors"].items()}
    state["actors"] = {name: entry[:7] for name, entry in state["actors"].items()}
    return taken


def check_replay(file, count, *options, atol, velocity_atol=None):
    """ManiSkill's tool, in a process that knows nothing of hab_tasks, comes to the same states.

    But for the first one. Velocities of objects [m/s, rad/s] may differ by `velocity_atol`, or else
    by `atol` as well.

    Returns:
        The file that the tool has written.
    """
    before = set(file.parent.glob("*.h5"))
    command = [*REPLAY, str(file), "--save-traj", "--allow-failure", *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]
    (made,) = set(file.parent.glob("*.h5")) - before
    assert len(told(made)["episodes"]) == count
    with h5py.File(file) as a, h5py.File(made) as b:
        for name in b:
            assert np.array_equal(a[name]["actions"], b[name]["actions"])
            assert np.array_equal(a[name]["success"], b[name]["success"])
            runs = (trajectory_utils.dict_to_list_of_dicts(f[name]["env_states"]) for f in (a, b))
            for x, y in list(zip(*runs, strict=True))[1:]:
                moving = velocities_taken_from(x), velocities_taken_from(y)
                assert same(*moving, atol=velocity_atol or atol), name
                assert same(x, y, atol=atol), name
    return made


def test_episodes_follow_one_another_over_layouts_and_a_seed_starts_them_again(make, tmp_path):
    env_id = "HabSetTable-v1"
    env = make(env_id)
    played = recorded(make(env_id), tmp_path, [3, None, None, 1])
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
            env.reset(seed=entry["episode_seed"])
            assert env.unwrapped.episode == (episode,)


def test_states_of_other_objects_are_refused(make):
    env = make()
    env.reset(options={"episode": 0})
    assert not env.reset(options={"episode": 0})[1]["reconfigure"]
    base, words = env.unwrapped, "Start the episode of the state first"
    state, flat = base.get_state_dict(), base.get_state()
    assert env.reset(options={"episode": 1})[1]["reconfigure"]
    refused_by_call(lambda: base.set_state_dict(state), words)
    refused_by_call(lambda: base.set_state(flat), words)
    # As wide as this episode's, but of another layout.
    refused_by_call(lambda: base.set_state(base.get_state().flip(1)), words)
    refused_by_call(lambda: base.set_state_dict({}), "The state has no")


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
    recorded(gym.make(env_id), tmp_path, [0, None, None])
    mode = told(tmp_path / "t.h5")["episodes"][0]["control_mode"]
    options = [mode if option == "same" else option for option in options]
    count = 2 if "--count" in options else 3
    made = check_replay(tmp_path / "t.h5", count, *options, atol=atol)
    if "rgb+depth" in options:
        with h5py.File(made) as file:
            assert sorted(file["traj_1/obs/sensor_data/head"]) == ["depth", "rgb"]


@slow
@pytest.mark.assets
def test_recordings_of_the_real_rooms_replay(replica_cad, ycb, tmp_path):
    env = gym.make("HabPlace-v1", scene_dataset=str(replica_cad), objects=str(ycb))
    recorded(env, tmp_path, [0, None, None])
    # A state holds no contact forces of the step before: where a can tumbles at 2.1 rad/s, its
    # velocity after the next step differs by 0.16 rad/s.
    options = ("--use-env-states", "-o", "state")
    check_replay(tmp_path / "t.h5", 3, *options, atol=1e-2, velocity_atol=0.3)


def test_rows_that_cannot_be_simulated_are_refused_with_advice():
    advice = "gymnasium.make_vec('hab_tasks:HabPick-v1', num_envs=N)"
    for options, words in (
        ({"num_envs": 2}, "num_envs is 2; it has to be 1."),
        ({"sim_backend": "physx_cuda:0"}, "it has to be 'physx_cpu'"),
    ):
        refused_by_call(lambda o=options: gym.make("HabPick-v1", **o), words, advice)
