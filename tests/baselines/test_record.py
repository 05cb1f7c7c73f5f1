"""Demonstrations: recorded content, ManiSkill's replay, LeRobot's format, folders for the hub."""

import dataclasses
import hashlib
import io
import json
import shutil
import subprocess
import sys

import gymnasium as gym
import h5py
import imageio.v2 as imageio
import numpy as np
import pytest
from builders import same
from hab_ppo.agent import WEIGHTS
from hab_spa.cli import main
from hab_spa.recording import playing as module
from hab_spa.recording.frames import Seen
from hab_spa.recording.lerobot_format import write_dataset
from mani_skill.trajectory.dataset import load_h5_data
from PIL import Image
from pyarrow import parquet
from refusals import refused_by_command

from hab_tasks.cli import main as hab_tasks
from hab_tasks.robots.fetch import FETCH

ENV = "hab_tasks:HabPick-v1"
PICK = ("--agent", "hab_spa:spa_priv", "--env", "HabPick-v1")
IMAGES = ("--lerobot", "--obs-mode", "depth", "--cameras", "head", "--camera-size", 32)
REPLAY = (sys.executable, "-m", "mani_skill.trajectory.replay_trajectory", "--traj-path")


def record(folder, *options, agent=PICK):
    return main(["record", *agent, "--out", str(folder), *map(str, options)])


def replayed(folder, *options):
    """What ManiSkill's tool, in a process of its own, says of a recording."""
    command = [*REPLAY, str(folder / "trajectory.h5"), *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stdout


def told(folder):
    return json.loads((folder / "trajectory.json").read_text())


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Two demonstrations of Pick in the apartment, in both formats, with depth images."""
    folder = tmp_path_factory.mktemp("recording")
    assert record(folder, "--count", 2, *IMAGES) == 0
    return folder


# ManiSkill's trajectories ----------------------------------------------------------------------


@pytest.mark.slow
def test_maniskills_own_tool_replays_a_recording_to_success(recording):
    assert "2/2=100.00% demos saved" in replayed(recording)


def test_a_recording_says_what_was_played(recording):
    info, (episode, _) = told(recording)["env_info"], told(recording)["episodes"]
    assert info["env_id"] == "hab_tasks:HabPick-v1"
    assert info["env_kwargs"]["split"] == "train"
    assert episode["episode"] == "HabPick-v1/apartment/train/0/00000"
    assert episode["reset_kwargs"]["options"]["episode"] == 0
    assert episode["task"] == "Pick up the pudding box from the right counter."
    assert episode["stages"] == [[0, episode["task"]]]  # a skill has one
    assert episode["success"] is True
    with h5py.File(recording / "trajectory.h5") as file:
        assert list(file) == ["traj_0", "traj_1"]
        assert set(file["traj_0/obs"]) == {"agent", "extra"}  # images are in the dataset
        assert len(file["traj_0/actions"]) == episode["elapsed_steps"]
        assert bool(file["traj_0/success"][-1])


@pytest.mark.slow
def test_only_what_was_solved_is_kept(tmp_path, monkeypatch, capsys):
    """The second of three episodes counts as failed: the first and the third are kept."""
    play = module.run_episode

    def flaky(env, agent, number, *rest, **options):
        finished = play(env, agent, number, *rest, **options)
        if number != 1:
            return finished
        failed = dataclasses.replace(finished.episode, success=False, failure="motion plan")
        return dataclasses.replace(finished, episode=failed)

    monkeypatch.setattr(module, "run_episode", flaky)
    assert record(tmp_path, "--count", 2) == 0
    shown = capsys.readouterr().out
    assert "1 of 3 episodes failed: motion plan" in shown
    assert "2 of 2 demonstrations" in shown
    episodes = told(tmp_path)["episodes"]
    assert [entry["reset_kwargs"]["options"]["episode"] for entry in episodes] == [0, 2]
    assert [entry["episode"][-5:] for entry in episodes] == ["00000", "00002"]
    with h5py.File(tmp_path / "trajectory.h5") as file:
        assert list(file) == ["traj_0", "traj_1"]


def test_an_agent_that_raises_is_named_with_its_episode(tmp_path, monkeypatch, capsys):
    def broken(*_, **__):
        raise ValueError("no idea")

    monkeypatch.setattr(module, "run_episode", broken)
    assert record(tmp_path, "--count", 1, "--split", "val") == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "00000' stopped the recording: ValueError: no idea. Nothing was written" in line
    assert not list(tmp_path.iterdir())


def test_a_bad_value_is_told_in_one_line(tmp_path):
    arguments = ["record", *PICK, "--out", tmp_path, "--most", "3", "--count", "4"]
    refused_by_command(main, arguments, "hab-spa: ", "most must be at least count, 4, got 3")
    arguments = ["record", *PICK, "--out", tmp_path, "--obs-mode", "rgb"]
    refused_by_command(main, arguments, "--obs-mode needs --lerobot", "replay_trajectory")
    refused_by_command(main, [*arguments[:-1], "rbg", "--lerobot"], "'rbg'", "rgb+depth")
    arguments += ["--lerobot", "--agent", "hab_ppo:pick_depth"]
    refused_by_command(main, arguments, "state_dict", "observes depth")
    assert not list(tmp_path.iterdir())


# LeRobot's format ------------------------------------------------------------------------------


def frames_of(folder):
    """The frames of the first episode."""
    table = parquet.read_table(folder / "lerobot/data/chunk-000/file-000.parquet").to_pydict()
    count = table["episode_index"].count(0)
    return {name: column[:count] for name, column in table.items()}


def test_a_frame_holds_what_was_seen_done_and_paid(recording):
    frames = frames_of(recording)
    with h5py.File(recording / "trajectory.h5") as file:
        trajectory = file["traj_0"]
        count = len(trajectory["actions"])
        assert np.array_equal(frames["action"], trajectory["actions"])
        state = np.array(frames["observation.state"])
        assert state.shape == (count, 20)  # 7 joints, hand 3 and 6, holding 1, rest 3
        assert np.array_equal(state[:, :7], trajectory["obs/agent/arm_qpos"][:count])
        targets = np.array(frames["observation.environment_state"])
        assert np.array_equal(targets, trajectory["obs/extra/object_start_from_ee"][:count])
        assert np.array_equal(frames["next.reward"], trajectory["rewards"])
    assert frames["next.done"] == frames["next.success"] == [False] * (count - 1) + [True]
    # 30 actions a second
    assert frames["timestamp"] == pytest.approx(np.arange(count) / 30)
    assert set(frames["subtask"]) == {told(recording)["episodes"][0]["task"]}


def first_observation(recording, obs_mode):
    """What the environment of a recording observes at the start of its first episode."""
    env = gym.make(ENV, **told(recording)["env_info"]["env_kwargs"] | {"obs_mode": obs_mode})
    obs, info = env.reset(options={"episode": 0})
    env.close()
    return obs["sensor_data"], info["instruction"]


def test_depth_is_in_millimetres(recording):
    columns = frames_of(recording)["observation.images.head_depth"]
    depth_mm = np.asarray(Image.open(io.BytesIO(columns[0]["bytes"])))
    assert depth_mm.dtype == np.uint16
    data, _ = first_observation(recording, "depth")
    assert np.array_equal(depth_mm, np.rint(data["head"]["depth"][0, ..., 0].numpy() * 10_000))


def test_what_describes_the_frames_fits_them(recording):
    meta, frames = recording / "lerobot/meta", frames_of(recording)
    info = json.loads((meta / "info.json").read_text())
    count = len(frames["index"])
    assert (info["codebase_version"], info["fps"], info["robot_type"]) == ("v3.0", 30, "hab_fetch")
    rows = parquet.read_table(meta / "episodes/chunk-000/file-000.parquet").to_pylist()
    total = sum(row["length"] for row in rows)
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (2, total, 2)
    assert list(info["features"]) == list(frames)
    for name, feature in info["features"].items():
        if feature["dtype"] == "image":
            assert feature["shape"] == [32, 32, 1]
            continue
        assert np.array(frames[name]).size == count * np.prod(feature["shape"], dtype=int)
        assert feature["names"] is None or len(feature["names"]) == feature["shape"][0]
    tasks = parquet.read_table(meta / "tasks.parquet").to_pydict()
    said = [episode["task"] for episode in told(recording)["episodes"]]
    assert tasks == {"task_index": [0, 1], "task": said}
    row = rows[0]
    assert (row["dataset_from_index"], row["dataset_to_index"], row["length"]) == (0, count, count)


def made_recording(folder, lengths):
    """A recording of made-up numbers, with a depth image of one pixel and a flat observation."""
    rng, episodes, seen = np.random.default_rng(0), [], []
    entries = (("agent", "own", 2), ("extra", "target", 1))
    with h5py.File(folder / "trajectory.h5", "w") as file:
        for number, steps in enumerate(lengths):
            episodes.append({"episode_id": number, "control_mode": "base"})
            told = {"task": f"t{number % 2}", "stages": ((0, "a"), (1, "b")), "entries": entries}
            seen.append(Seen(**told, shapes={}, stats={}))
            group = file.create_group(f"traj_{number}", track_order=True)
            group["obs"] = rng.normal(size=(steps + 1, 3)).astype(np.float32)
            group["actions"] = rng.normal(size=(steps, 2)).astype(np.float32)
            group["rewards"] = rng.normal(size=steps).astype(np.float32)
            group["terminated"] = group["success"] = np.arange(steps) == steps - 1
            group["truncated"] = np.zeros(steps, dtype=bool)
            (folder / f"traj_{number}").mkdir()
    (folder / "trajectory.json").write_text(json.dumps({"episodes": episodes}))
    return seen


def test_episodes_and_files_follow_one_another(tmp_path, monkeypatch):
    monkeypatch.setattr("hab_spa.recording.lerobot_format.FILE_SIZE_MB", 1e-6)
    seen = made_recording(tmp_path, [3, 5, 2])
    write_dataset(tmp_path / "trajectory.h5", tmp_path / "lerobot", FETCH, seen)
    files = sorted((tmp_path / "lerobot/data").rglob("*.parquet"))
    tables = [parquet.read_table(file).to_pydict() for file in files]
    frames = {name: [x for table in tables for x in table[name]] for name in tables[0]}
    assert [len(table["index"]) for table in tables] == [3, 5, 2]
    assert frames["index"] == list(range(10))
    assert frames["episode_index"] == [0] * 3 + [1] * 5 + [2] * 2
    assert frames["frame_index"] == [0, 1, 2, 0, 1, 2, 3, 4, 0, 1]
    assert frames["task_index"] == [0] * 3 + [1] * 5 + [0] * 2
    assert frames["subtask"] == [*"abb", *"abbbb", *"ab"]
    with h5py.File(tmp_path / "trajectory.h5") as file:  # a flat observation is split
        flat = np.concatenate([file[f"traj_{n}/obs"][:-1] for n in range(3)])
    assert np.array_equal(frames["observation.state"], flat[:, :2])
    assert np.array_equal(frames["observation.environment_state"], flat[:, 2])
    meta = tmp_path / "lerobot/meta/episodes/chunk-000/file-000.parquet"
    rows = parquet.read_table(meta).to_pylist()
    assert [row["data/file_index"] for row in rows] == [0, 1, 2]
    assert [row["dataset_from_index"] for row in rows] == [0, 3, 8]
    assert [row["tasks"] for row in rows] == [["t0"], ["t1"], ["t0"]]
    stats = json.loads((tmp_path / "lerobot/meta/stats.json").read_text())["action"]
    for name in ("mean", "std", "min", "max"):
        assert stats[name] == pytest.approx(getattr(np, name)(frames["action"], axis=0))
    assert stats["count"] == [10]


# For the Hugging Face hub ------------------------------------------------------------------------


def published(source, folder, *options):
    """The files of a folder that the command has prepared, by name."""
    assert hab_tasks(["publish", str(source), "--out", str(folder), *options]) == 0
    sums = [line.split("  ") for line in (folder / "SHA256SUMS").read_text().splitlines()]
    found = {name: (folder / name).read_bytes() for _, name in sums}
    assert [hashlib.sha256(data).hexdigest() for data in found.values()] == [s for s, _ in sums]
    return found


def test_a_sample_is_a_dataset_with_card_and_licence(recording, tmp_path):
    files = published(recording, tmp_path / "hub", "--episodes", "1")
    assert files["README.md"].startswith(b"---\nlicense: apache-2.0\n")
    assert b"1 demonstrations" in files["README.md"]
    assert b"Apache License" in files["LICENSE"]
    info, frames = json.loads(files["meta/info.json"]), frames_of(recording)
    table = parquet.read_table(tmp_path / "hub/data/chunk-000/file-000.parquet")
    assert table.to_pydict() == frames
    assert (info["total_episodes"], info["total_frames"]) == (1, table.num_rows)
    stats = json.loads(files["meta/stats.json"])
    assert stats["action"]["mean"] == pytest.approx(np.mean(frames["action"], axis=0))
    assert list(h5py.File(tmp_path / "hub/maniskill/trajectory.h5")) == ["traj_0"]

    copy = shutil.copytree(recording, tmp_path / "copy")
    about = told(copy)
    about["env_info"]["env_kwargs"]["scene_dataset"] = "/data/replica_cad"
    (copy / "trajectory.json").write_text(json.dumps(about))
    refused_by_command(hab_tasks, ["publish", copy, "--out", tmp_path / "x"], "--license")
    files = published(copy, tmp_path / "theirs", "--license", "cc-by-nc-4.0")
    assert "LICENSE" not in files
    assert b"/data/" not in files["README.md"]


def test_weights_and_the_environment_have_cards(tmp_path):
    files = published(WEIGHTS / "pick_blind.safetensors", tmp_path / "weights")
    assert {"README.md", "LICENSE", "pick_blind.safetensors", "pick_blind.png"} == set(files)
    files = published("environment", tmp_path / "env")
    assert b"import make_env" in files["env.py"]
    words = "'environment'", "hab-spa record --lerobot"
    refused_by_command(hab_tasks, ["publish", tmp_path, "--out", tmp_path / "x"], *words)


@pytest.mark.slow
@pytest.mark.parametrize("executor", ["local", "ray"])
def test_workers_write_what_one_process_does(recording, tmp_path, executor):
    """Order, states, descriptions and images are the same."""
    if executor == "ray":
        pytest.importorskip("ray", reason="the package ray is not installed")
    workers = ("--executor", executor, "--workers", 2)
    assert record(tmp_path, "--count", 2, *IMAGES, *workers) == 0
    assert told(tmp_path) == told(recording)
    one, two = (load_h5_data(h5py.File(at / "trajectory.h5")) for at in (recording, tmp_path))
    assert same(one, two)
    files = [file for file in (recording / "lerobot").rglob("*") if file.is_file()]
    assert len(files) == 5
    for file in files:
        assert file.read_bytes() == (tmp_path / file.relative_to(recording)).read_bytes(), file


@pytest.mark.slow
@pytest.mark.render
def test_videos_show_what_was_seen(tmp_path):
    options = ("--count", 1, "--lerobot", "--obs-mode", "rgb", "--cameras", "third_person")
    told_varied = ("--instructions", "varied", "--targets", "language")
    assert record(tmp_path, *options, *told_varied, "--camera-size", 64) == 0
    meta = json.loads((tmp_path / "lerobot/meta/info.json").read_text())
    name = "observation.images.third_person"
    assert (meta["features"][name]["dtype"], meta["features"][name]["shape"]) == (
        "video",
        [64, 64, 3],
    )
    assert "observation.environment_state" not in meta["features"]
    (video,) = (tmp_path / "lerobot/videos" / name).rglob("*.mp4")
    shown = imageio.mimread(video)
    assert len(shown) == meta["total_frames"]
    data, instruction = first_observation(tmp_path, "rgb")
    first = data["third_person"]["rgb"][0].numpy()
    assert np.abs(shown[0].astype(int) - first).mean() < 6  # of 255; the codec loses a little
    assert [told(tmp_path)["episodes"][0]["task"]] == instruction
