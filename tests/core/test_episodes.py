"""Episode files, where episodes come from, and what Pick's start states look like."""

import gzip
import json
import math
import os
import re
import shutil
import subprocess
import sys
from dataclasses import asdict, replace

import numpy as np
import pytest
from transforms3d import quaternions

from hab_tasks.episodes import EpisodeSet, load_episodes, open_source, read_episodes, write_episodes
from hab_tasks.episodes.generate import PickStart
from hab_tasks.episodes.source import GENERATORS
from hab_tasks.episodes.spots import PICK_RECEPTACLES, find_spots
from hab_tasks.episodes.workbench import Workbench
from hab_tasks.errors import EpisodeError, GenerationError, UnknownNameError
from hab_tasks.robots.fetch_spec import ARM_LOWER_RAD, ARM_UPPER_RAD
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.scenes.dataset import embedded_dataset

ENV, COUNT, SEED = "HabPick-v1", 6, 77
START = PickStart()


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    """Nothing that was generated before is found."""
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HAB_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        made = open_source(env_id=ENV, seed=SEED)
        for index in range(COUNT):
            made.get(index)
        return made


@pytest.fixture(scope="module")
def episodes(source):
    return source.to_set(COUNT)


@pytest.fixture(scope="module")
def bench(source):
    """The layout that every episode of `source` is in, as the generator sees it."""
    (scene_id,) = {source.get(i).scene_id for i in range(COUNT)}
    return Workbench(source.scene(scene_id), source.objects)


# Files -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["set.json", "set.json.gz"])
def test_round_trip(tmp_path, episodes, name):
    write_episodes(episodes, tmp_path / "new/folder" / name)
    assert read_episodes(tmp_path / "new/folder" / name) == episodes
    assert [p.name for p in (tmp_path / "new/folder").iterdir()] == [name], "something is left over"


@pytest.mark.parametrize("name", ["set.json", "set.json.gz"])
def test_the_same_set_gives_the_same_bytes(tmp_path, episodes, name):
    for folder in ("a", "b"):
        write_episodes(replace(episodes), tmp_path / folder / name)
    assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_a_new_file_can_be_read_by_others(tmp_path, episodes):
    umask = os.umask(0o022)
    try:
        write_episodes(episodes, tmp_path / "set.json")
    finally:
        os.umask(umask)
    assert (tmp_path / "set.json").stat().st_mode & 0o777 == 0o644


def test_an_empty_set_is_fine(tmp_path):
    empty = EpisodeSet(env=ENV, scene_dataset="x", split="train", seed=0, episodes=())
    write_episodes(empty, tmp_path / "set.json")
    assert read_episodes(tmp_path / "set.json") == empty


def refused(file, content, match):
    file.write_bytes(content)
    with pytest.raises(EpisodeError, match=re.escape(str(file)) + ": .*" + match):
        read_episodes(file)


@pytest.mark.parametrize("version", [0, 2, None, "1"])
def test_another_schema_version_is_refused(tmp_path, episodes, version):
    write_episodes(episodes, tmp_path / "set.json")
    raw = json.loads((tmp_path / "set.json").read_text()) | {"schema": version}
    refused(tmp_path / "set.json", json.dumps(raw).encode(), "schema")


def test_a_truncated_or_damaged_file_is_refused(tmp_path, episodes):
    file = tmp_path / "set.json.gz"
    write_episodes(episodes, file)
    whole = file.read_bytes()
    damaged = bytearray(whole)
    damaged[12:40] = b"\xff" * 28  # the compressed stream's first bytes
    for content in (whole[:-200], bytes(damaged), b"", b"not gzip"):
        refused(file, content, "not a valid episode file")
    refused(tmp_path / "set.json", gzip.decompress(whole)[:-10], "not a valid episode file")


@pytest.mark.parametrize("content", ["[1]", "3", "null"])
def test_json_that_is_no_episode_set_is_refused(tmp_path, content):
    refused(tmp_path / "set.json", content.encode(), "schema")


@pytest.mark.parametrize(
    "damage",
    [
        lambda e: e.update(target="a_ghost"),
        lambda e: e.pop("robot"),
        lambda e: e["robot"].update(base=[0, 1]),
        lambda e: e["robot"].update(arm_qpos_rad=[0] * 6),
        lambda e: e["objects"].update({e["target"]: [0, 0, 0]}),
        lambda e: e.update(scene_id="elsewhere"),
        lambda e: e.update(receptacle=[]),
        lambda e: e["objects"].update({e["target"]: ["x"] * 7}),
    ],
    ids=["target", "no robot", "base", "arm", "pose", "scene", "receptacle", "text"],
)
def test_a_malformed_episode_is_refused(tmp_path, episodes, damage):
    write_episodes(episodes, tmp_path / "set.json")
    raw = json.loads((tmp_path / "set.json").read_text())
    damage(raw["episodes"][1])
    refused(tmp_path / "set.json", json.dumps(raw).encode(), "")


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(EpisodeError, match=r"gone\.json: no such file"):
        read_episodes(tmp_path / "gone.json")


# Sources ---------------------------------------------------------------------------------------


def test_a_file_serves_its_episodes_and_no_more(tmp_path, episodes):
    write_episodes(episodes, tmp_path / "set.json")
    source = open_source(env_id=ENV, episode_file=tmp_path / "set.json")
    assert source.available == COUNT
    assert source.get(COUNT - 1) == episodes.episodes[-1]
    for index in (COUNT, -1):
        with pytest.raises(EpisodeError, match=f"valid are 0 to {COUNT - 1}"):
            source.get(index)


def test_a_file_for_another_env_is_refused(tmp_path, episodes):
    write_episodes(replace(episodes, env="HabPlace-v1"), tmp_path / "set.json")
    with pytest.raises(EpisodeError, match=r"set\.json: made for HabPlace-v1"):
        open_source(env_id=ENV, episode_file=tmp_path / "set.json")


def test_a_file_for_another_dataset_is_refused(tmp_path, episodes):
    other = replace(episodes.episodes[0], scene_id="v3_sc9_staging_00")
    write_episodes(replace(episodes, episodes=(other,)), tmp_path / "set.json")
    with pytest.raises(UnknownNameError, match="v3_sc9_staging_00"):
        open_source(env_id=ENV, episode_file=tmp_path / "set.json")


def test_loaded_episodes_are_cached_and_reported(tmp_path):
    seen = []
    first = load_episodes(ENV, count=2, seed=5, progress=lambda *n: seen.append(n))
    assert seen == [(1, 2), (2, 2)]
    (file,) = (tmp_path / "cache/episodes").rglob("*.json.gz")
    assert read_episodes(file) == first
    assert load_episodes(ENV, count=2, seed=5) == first
    assert load_episodes(ENV, count=1, seed=5).episodes == first.episodes[:1]


def test_unknown_names_are_named():
    with pytest.raises(UnknownNameError, match="Did you mean 'train'"):
        open_source(env_id=ENV, split="trian")
    with pytest.raises(UnknownNameError, match="v3_sc7"):
        open_source(env_id=ENV, scene_id="v3_sc7")
    with pytest.raises(UnknownNameError, match="HabFly-v1"):
        open_source(env_id="HabFly-v1").get(0)


# Generation ------------------------------------------------------------------------------------


def test_episodes_depend_only_on_dataset_split_seed_and_index(episodes):
    """A new process that makes one late episode first, and another seed before it."""
    code = f"""
import json
from dataclasses import asdict
from hab_tasks.episodes import open_source
open_source(env_id="{ENV}", seed=3).get(0)
source = open_source(env_id="{ENV}", seed={SEED})
print(json.dumps([asdict(source.get(i)) for i in (4, 1)]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    again = json.loads(done.stdout.splitlines()[-1])
    expected = [json.loads(json.dumps(asdict(episodes.episodes[i]))) for i in (4, 1)]
    assert again == expected


def test_seeds_and_indices_give_different_episodes(episodes):
    other = open_source(env_id=ENV, seed=SEED + 1).get(0)
    bases = [e.robot.base for e in (*episodes.episodes, other)]
    assert len(set(bases)) == COUNT + 1
    assert len({e.id for e in episodes.episodes}) == COUNT


@pytest.mark.parametrize("env_id", GENERATORS)
def test_an_impossible_start_counts_its_refusals(env_id, source):
    scenes = [source.get(0).scene_id]
    start = replace(START, farthest_base_m=0.01)
    generator = GENERATORS[env_id](
        scenes=scenes, load=source.scene, objects=source.objects, start=start, attempts=3
    )
    with pytest.raises(GenerationError, match=r"no free floor near the target': \d"):
        generator.generate("an id", (1, 2))


def test_rejections_are_counted_and_stored(source, episodes):
    assert episodes.rejections == dict(source.rejections)
    assert all(count > 0 for count in episodes.rejections.values())


@pytest.mark.parametrize("index", range(COUNT))
def test_objects_stand_upright_on_the_receptacle(index, episodes, bench, source):
    episode = episodes.episodes[index]
    assert episode.receptacle[0] in PICK_RECEPTACLES
    assert START.clutter[0] <= len(episode.objects) <= 1 + START.clutter[1]
    spot = next(
        s for s in find_spots(bench) if (s.receptacle.name, s.receptacle.body) == episode.receptacle
    )
    for name, pose in episode.objects.items():
        bench.place(name, pose)
        _, body = bench._components[name]
        low, high = body.compute_global_aabb_tight()
        # Its lowest point lies on the receptacle's bottom face; cushions of a sofa are not flat.
        assert abs(low[2] - spot.center_m[2]) < 0.015, name
        up = quaternions.rotate_vector(source.objects[name].up, pose[3:])
        # Settling may tilt an object by tilt_rad; none lies on its side.
        assert math.acos(min(1.0, up[2])) < START.tilt_rad + 1e-6, name
        away = np.abs((np.add(low, high) / 2 - spot.center_m)[:2] @ spot.axes[:2])
        assert (away < spot.half_m + 0.1).all(), f"{name} lies beside the receptacle"


@pytest.mark.parametrize("index", range(COUNT))
def test_the_robot_faces_the_target_from_free_floor(index, episodes, bench):
    episode = episodes.episodes[index]
    for name, pose in episode.objects.items():
        bench.place(name, pose)
    for furniture, joints in episode.joints.items():
        for joint, value in joints.items():
            bench.set_joint(furniture, joint, value)
    x, y, yaw = episode.robot.base
    gap = bench.com_m(episode.target)[:2] - (x, y)
    off = math.remainder(math.atan2(gap[1], gap[0]) - yaw, math.tau)
    assert abs(off) <= math.radians(20.0) + 1e-6
    # Nearest to farthest cell, and 0.1 m of noise in x and in y.
    noise = math.hypot(0.1, 0.1)
    assert START.nearest_base_m - noise <= np.linalg.norm(gap) <= START.farthest_base_m + noise
    assert bench.floor().clearance_at(np.array([x, y])) >= START.base_clearance_m - noise - 0.05
    assert not bench.robot_touches(episode.robot.base, np.array(episode.robot.arm_qpos_rad))
    bench.clear()


@pytest.mark.parametrize("index", range(COUNT))
def test_the_hand_starts_near_rest(index, episodes):
    arm = np.array(episodes.episodes[index].robot.arm_qpos_rad)
    assert (arm >= ARM_LOWER_RAD).all()
    assert (arm <= ARM_UPPER_RAD).all()
    off = np.abs(ArmKinematics().position(arm) - (0.5, 0.0, 1.0))
    # 5 cm of noise on each axis; the solver stops within 5 mm.
    assert (off <= START.ee_noise_m + 0.005).all()


def test_starts_vary(episodes):
    assert len({e.target for e in episodes.episodes}) >= 3
    assert len({e.receptacle for e in episodes.episodes}) >= 3
    yaws = []
    for e in episodes.episodes:
        gap = np.subtract(e.objects[e.target][:2], e.robot.base[:2])
        yaws.append(math.remainder(math.atan2(gap[1], gap[0]) - e.robot.base[2], math.tau))
    assert np.std(yaws) > math.radians(3.0), "the heading's noise is missing"


def test_more_episodes_than_were_shipped_are_kept_in_the_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path))
    shipped = open_source(env_id="HabPick-v1")
    count = len(shipped._episodes)
    assert count == 100
    more = load_episodes("HabPick-v1", count=count + 1)
    again = open_source(env_id="HabPick-v1")
    assert again._episodes[count] == more.episodes[count]
    assert again._episodes[0] == shipped.get(0)


def test_episodes_start_on_a_stage_that_is_only_a_mesh(tmp_path, monkeypatch):
    """As in the complete ReplicaCAD, whose stages have no collision parts."""
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))
    root = tmp_path / "flat"
    shutil.copytree(embedded_dataset(), root)
    for file in (root / "configs/stages").glob("*.json"):
        config = json.loads(file.read_text())
        del config["collision_asset"]
        file.write_text(json.dumps(config))
    assert len(load_episodes("HabPick-v1", root, count=2)) == 2
