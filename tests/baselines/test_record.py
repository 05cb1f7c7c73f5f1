"""Demonstrations: recorded content, ManiSkill's replay, and LeRobot's format."""

import dataclasses
import io
import json
import subprocess
import sys

import h5py
import numpy as np
import pytest
from builders import same
from hab_spa.cli import main
from hab_spa.recording import record as module
from hab_spa.recording.lerobot_format import write_dataset
from mani_skill.trajectory.dataset import load_h5_data
from PIL import Image
from pyarrow import parquet
from refusals import refused_by_command

from hab_tasks.robots.fetch import FETCH

PICK = ("--agent", "hab_spa:spa_priv", "--env", "HabPick-v1")
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
    """One demonstration of Pick in the apartment, in both formats."""
    folder = tmp_path_factory.mktemp("recording")
    assert record(folder, "--count", 1, "--lerobot") == 0
    return folder


# ManiSkill's trajectories ----------------------------------------------------------------------


@pytest.mark.slow
def test_maniskills_own_tool_replays_a_recording_to_success(recording):
    assert "1/1=100.00% demos saved" in replayed(recording)


def test_a_recording_says_what_was_played(recording):
    info, (episode,) = told(recording)["env_info"], told(recording)["episodes"]
    assert info["env_id"] == "hab_tasks:HabPick-v1"
    assert info["env_kwargs"]["split"] == "train"
    assert episode["episode"] == "HabPick-v1/apartment/train/0/00000"
    assert episode["reset_kwargs"]["options"]["episode"] == 0
    assert episode["task"] == "Pick up the pudding box from the right counter."
    assert episode["success"] is True
    with h5py.File(recording / "trajectory.h5") as file:
        assert list(file) == ["traj_0"]
        assert len(file["traj_0/actions"]) == episode["elapsed_steps"]
        assert bool(file["traj_0/success"][-1])


@pytest.mark.slow
def test_only_what_was_solved_is_kept(tmp_path, monkeypatch, capsys):
    """The second of three episodes counts as failed: the first and the third are kept."""
    play = module.run_episode

    def flaky(env, agent, number, episode, restart):
        finished = play(env, agent, number, episode, restart=restart)
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
    assert not list(tmp_path.iterdir())


# LeRobot's format ------------------------------------------------------------------------------


def frames_of(folder):
    return parquet.read_table(folder / "lerobot/data/chunk-000/file-000.parquet").to_pydict()


def test_a_frame_holds_what_was_seen_done_and_paid(recording):
    frames = frames_of(recording)
    with h5py.File(recording / "trajectory.h5") as file:
        trajectory = file["traj_0"]
        count = len(trajectory["actions"])
        assert np.array_equal(frames["action"], trajectory["actions"])
        state = np.array(frames["observation.state"])
        assert state.shape == (count, 23)  # 7 joints, hand 3 and 6, holding 1, rest 3, target 3
        assert np.array_equal(state[:, :7], trajectory["obs/agent/arm_qpos"][:count])
        assert np.array_equal(state[:, 20:], trajectory["obs/extra/object_start_from_ee"][:count])
        assert np.array_equal(frames["next.reward"], trajectory["rewards"])
    assert frames["next.done"] == frames["next.success"] == [False] * (count - 1) + [True]
    # 30 actions a second
    assert frames["timestamp"] == pytest.approx(np.arange(count) / 30)


def test_what_describes_the_frames_fits_them(recording):
    meta, frames = recording / "lerobot/meta", frames_of(recording)
    info = json.loads((meta / "info.json").read_text())
    count = len(frames["index"])
    assert (info["codebase_version"], info["fps"], info["robot_type"]) == ("v3.0", 30, "hab_fetch")
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (1, count, 1)
    assert list(info["features"]) == list(frames)
    for name, feature in info["features"].items():
        assert np.array(frames[name]).size == count * np.prod(feature["shape"], dtype=int)
        assert feature["names"] is None or len(feature["names"]) == feature["shape"][0]
    tasks = parquet.read_table(meta / "tasks.parquet").to_pydict()
    assert tasks == {"task_index": [0], "task": [told(recording)["episodes"][0]["task"]]}
    (row,) = parquet.read_table(meta / "episodes/chunk-000/file-000.parquet").to_pylist()
    assert (row["dataset_from_index"], row["dataset_to_index"], row["length"]) == (0, count, count)


def made_trajectory(folder, lengths):
    """A recording with two cameras of 2 x 2 pixels, made up."""
    rng, episodes = np.random.default_rng(0), []
    with h5py.File(folder / "trajectory.h5", "w") as file:
        for number, steps in enumerate(lengths):
            episodes.append(
                {"episode_id": number, "control_mode": "base", "task": f"t{number % 2}"}
            )
            group = file.create_group(f"traj_{number}", track_order=True)
            group["obs/extra/entry"] = rng.normal(size=(steps + 1, 2)).astype(np.float32)
            depth = np.full((steps + 1, 2, 2, 1), 0.4, dtype=np.float32)
            group["obs/sensor_data/head/depth"] = depth
            pictures = rng.integers(0, 256, (steps + 1, 2, 2, 3), dtype=np.uint8)
            group["obs/sensor_data/arm/rgb"] = pictures
            group["actions"] = rng.normal(size=(steps, 2)).astype(np.float32)
            group["rewards"] = rng.normal(size=steps).astype(np.float32)
            group["terminated"] = group["success"] = np.arange(steps) == steps - 1
            group["truncated"] = np.zeros(steps, dtype=bool)
    (folder / "trajectory.json").write_text(json.dumps({"episodes": episodes}))


def test_pictures_are_kept_and_depth_is_grey(tmp_path):
    made_trajectory(tmp_path, [3])
    write_dataset(tmp_path / "trajectory.h5", tmp_path / "lerobot", FETCH)
    frames = frames_of(tmp_path)

    def pictures(name):
        column = frames[f"observation.images.{name}"]
        return [np.asarray(Image.open(io.BytesIO(entry["bytes"]))) for entry in column]

    with h5py.File(tmp_path / "trajectory.h5") as file:
        assert np.array_equal(pictures("arm"), file["traj_0/obs/sensor_data/arm/rgb"][:3])
    assert (pictures("head_depth")[0] == 102).all()  # 0.4 of 255


def test_episodes_and_files_follow_one_another(tmp_path, monkeypatch):
    monkeypatch.setattr("hab_spa.recording.lerobot_format.FILE_SIZE_MB", 1e-6)
    made_trajectory(tmp_path, [3, 5, 2])
    write_dataset(tmp_path / "trajectory.h5", tmp_path / "lerobot", FETCH)
    files = sorted((tmp_path / "lerobot/data").rglob("*.parquet"))
    tables = [parquet.read_table(file).to_pydict() for file in files]
    frames = {name: [x for table in tables for x in table[name]] for name in tables[0]}
    assert [len(table["index"]) for table in tables] == [3, 5, 2]
    assert frames["index"] == list(range(10))
    assert frames["episode_index"] == [0] * 3 + [1] * 5 + [2] * 2
    assert frames["frame_index"] == [0, 1, 2, 0, 1, 2, 3, 4, 0, 1]
    assert frames["task_index"] == [0] * 3 + [1] * 5 + [0] * 2
    meta = tmp_path / "lerobot/meta/episodes/chunk-000/file-000.parquet"
    rows = parquet.read_table(meta).to_pylist()
    assert [row["data/file_index"] for row in rows] == [0, 1, 2]
    assert [row["dataset_from_index"] for row in rows] == [0, 3, 8]
    assert [row["tasks"] for row in rows] == [["t0"], ["t1"], ["t0"]]
    stats = json.loads((tmp_path / "lerobot/meta/stats.json").read_text())["action"]
    for name in ("mean", "std", "min", "max"):
        assert stats[name] == pytest.approx(getattr(np, name)(frames["action"], axis=0))
    assert stats["count"] == [10]


@pytest.mark.slow
def test_a_recording_on_ray_has_the_content_of_a_local_one(tmp_path):
    """Two workers play the episodes; order, states and descriptions are those of one process."""
    pytest.importorskip("ray", reason="the package ray is not installed")
    ray = ("--executor", "ray", "--workers", 2)
    for name, options in {"local": (), "ray": ray}.items():
        assert record(tmp_path / name, "--count", 2, *options) == 0
    assert told(tmp_path / "local") == told(tmp_path / "ray")

    local, distributed = (
        load_h5_data(h5py.File(tmp_path / name / "trajectory.h5")) for name in ("local", "ray")
    )
    assert same(local, distributed)
