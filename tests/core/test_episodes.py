"""Episode files and episode sources."""

import json
import os
import re
from dataclasses import replace

import numpy as np
import pytest

from hab_tasks.episodes import (
    Episode,
    EpisodeRequest,
    EpisodeSet,
    load_episodes,
    open_source,
    read_episodes,
    write_episodes,
)
from hab_tasks.episodes.provenance import MadeFrom
from hab_tasks.episodes.schema import (
    HandleRef,
    NavigationGoal,
    Rearrangement,
    RobotStart,
    template_of,
)
from hab_tasks.errors import EpisodeError, UnknownNameError

ENV = "HabPick-v1"
MADE_FROM = MadeFrom(dataset="0123abcd", objects="embedded", masses="89ef4567", generator=8)
SCENES = ("v3_sc0_staging_00", "apt_0")
SUFFIXES = (".json", ".json.gz")


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    """Nothing that was generated before is found."""
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))


def random_pose(rng):
    turn = rng.normal(size=4)
    return tuple(float(x) for x in (*rng.normal(size=3), *(turn / np.linalg.norm(turn))))


def random_base(rng):
    return tuple(float(x) for x in rng.normal(size=3))


def random_episode(rng, index, loose):
    """An episode in which every field may be there or not."""
    handles = [f"0{rng.integers(100):02d}_thing_:{i:04d}" for i in range(rng.integers(1, 6))]
    refs = [(f"receptacle_{i}", f"furniture_:{i:04d}/link") for i in range(4)]
    targets = []
    for handle in handles[: rng.integers(0, len(handles) + 1)]:
        start, goal = (refs[i] if i < 4 else None for i in rng.integers(6, size=2))
        pose = random_pose(rng) if goal else None
        targets.append(Rearrangement(object=handle, start=start, goal=goal, world_from_goal=pose))
    joints = {f"a_:{i:04d}": {"slide": float(rng.uniform()), "door": -0.5} for i in range(2)}
    scene_id = SCENES[rng.integers(2)]
    return Episode(
        id=f"{ENV}/apartment/train/0/{index:05d}",
        scene_id=scene_id,
        seed=int(rng.integers(2**31)),
        robot=RobotStart(
            base=random_base(rng), arm_qpos_rad=tuple(float(x) for x in rng.normal(size=7))
        ),
        objects={handle: random_pose(rng) for handle in handles},
        targets=tuple(targets),
        held=handles[0] if rng.uniform() < 0.5 else None,
        handle=HandleRef(furniture="f_:0000", joint="j", marker="m") if index % 2 else None,
        navigation=NavigationGoal(skill=ENV, base=random_base(rng)) if index % 3 else None,
        joints=joints if index % 4 else {},
        loose=loose[scene_id],
        habitat={"kept": {"a": [1, 2.5, None]}} if index % 5 == 0 else {},
    )


def random_set(seed, count=20):
    rng = np.random.default_rng(seed)
    loose = {s: {f"cup_:{i:04d}": random_pose(rng) for i in range(3)} for s in SCENES}
    return EpisodeSet(
        env=ENV,
        scene_dataset="apartment",
        split="train",
        seed=seed,
        made_from=MADE_FROM,
        episodes=tuple(random_episode(rng, index, loose) for index in range(count)),
        rejections={"a reason": int(rng.integers(1, 9))},
        habitat={"config": {"x": 1}} if seed % 2 else {},
    )


# Files -----------------------------------------------------------------------------------------


def test_round_trip(tmp_path):
    for seed in range(4):
        for suffix in SUFFIXES:
            file = tmp_path / f"new{seed}/folder/set{suffix}"
            episodes = random_set(seed, 20 if seed else 0)
            write_episodes(episodes, file)
            assert read_episodes(file) == episodes
            file.unlink()
            assert not [*file.parent.iterdir()], "something is left over"


def test_the_same_set_gives_the_same_bytes(tmp_path):
    for suffix in SUFFIXES:
        first, second = tmp_path / f"a/set{suffix}", tmp_path / f"b/set{suffix}"
        write_episodes(random_set(1), first)
        write_episodes(random_set(1), second)
        assert first.read_bytes() == second.read_bytes()
    assert first.read_bytes()[4:8] == bytes(4), "gzip's header has the time"


def test_loose_objects_are_stored_once_for_each_layout(tmp_path):
    write_episodes(random_set(1), tmp_path / "set.json")
    raw = json.loads((tmp_path / "set.json").read_text())
    assert raw["scenes"].keys() == set(SCENES)
    assert not any("loose" in entry for entry in raw["episodes"])


def test_a_new_file_can_be_read_by_others(tmp_path):
    umask = os.umask(0o022)
    try:
        write_episodes(random_set(1), tmp_path / "set.json")
    finally:
        os.umask(umask)
    assert (tmp_path / "set.json").stat().st_mode & 0o777 == 0o644


def test_an_episode_names_its_first_target():
    episodes = random_set(2).episodes
    assert {e.target for e in episodes if not e.targets} == {""}
    assert all(e.target == e.targets[0].object for e in episodes if e.targets)
    assert template_of("024_bowl_:0001") == "024_bowl"
    assert template_of("frl_apartment_wall_cabinet_01_:0000") == "frl_apartment_wall_cabinet_01"


def test_a_refusal_names_the_file_the_episode_and_the_field(tmp_path):
    """`tests/faults/test_episode_files.py` has the malformed values themselves."""
    file = tmp_path / "set.json"
    changes = {
        "episode 1, field .*": lambda raw: raw["episodes"].insert(1, None),
        "episode 'a', field robot": lambda raw: raw["episodes"][3]["robot"].update(base=[0, 1]),
        "episode 'a', field objects": lambda raw: raw["episodes"][3].pop("objects"),
        "field .*env": lambda raw: raw.pop("env"),
        "episode schema 2; .*hab-tasks episodes": lambda raw: raw.update(schema=2),
    }
    for where, change in changes.items():
        write_episodes(random_set(1), file)
        raw = json.loads(file.read_text())
        raw["episodes"][3]["id"] = "a"
        change(raw)
        file.write_text(json.dumps(raw))
        with pytest.raises(EpisodeError, match=rf"{re.escape(str(file))}[:,] .*{where}"):
            read_episodes(file)


# Sources ---------------------------------------------------------------------------------------


@pytest.fixture
def pick(generated):
    """Generated episodes of Pick as a set."""
    source, episodes = generated(ENV)
    return source.to_set(len(episodes))


def test_a_file_serves_its_episodes_and_no_more(tmp_path, pick):
    write_episodes(pick, tmp_path / "set.json")
    source = open_source(EpisodeRequest(env_id=ENV, file=tmp_path / "set.json"))
    assert source.available == len(pick)
    assert source.get(len(pick) - 1) == pick.episodes[-1]
    for index in (len(pick), -1):
        with pytest.raises(EpisodeError, match=f"valid indices are 0 to {len(pick) - 1}"):
            source.get(index)


def test_a_file_for_another_env_or_dataset_is_refused(tmp_path, pick):
    file = tmp_path / "set.json"
    write_episodes(replace(pick, env="HabPlace-v1"), file)
    with pytest.raises(EpisodeError, match=r"set\.json: made for HabPlace-v1"):
        open_source(EpisodeRequest(env_id=ENV, file=file))
    other = replace(pick.episodes[0], scene_id="v3_sc9_staging_00")
    write_episodes(replace(pick, episodes=(other,)), file)
    with pytest.raises(UnknownNameError, match="v3_sc9_staging_00"):
        open_source(EpisodeRequest(env_id=ENV, file=file))


def test_loaded_episodes_are_cached_and_reported(tmp_path):
    seen = []
    request = EpisodeRequest(env_id=ENV, seed=5)
    first = load_episodes(request, count=2, progress=lambda *n: seen.append(n))
    assert seen == [(1, 2), (2, 2)]
    (file,) = (tmp_path / "cache/episodes").rglob("*.json.gz")
    assert read_episodes(file) == first
    assert load_episodes(request, count=2) == first
    assert load_episodes(request, count=1).episodes == first.episodes[:1]
    more = load_episodes(request, count=3)
    assert more.episodes[:2] == first.episodes
    assert len(read_episodes(file)) == 3


def test_what_a_request_names_is_what_comes():
    scene = open_source(EpisodeRequest(env_id=ENV)).dataset.scenes_of_split("train")[0]
    source = open_source(EpisodeRequest(env_id=ENV, split="train", scene=scene, seed=4))
    episode = source.get(1)
    assert episode.scene_id == scene
    assert episode.id == f"{ENV}/{source.dataset.name}/train/4/00001"
    novel = open_source(EpisodeRequest(env_id=ENV, split="train", seed=4, novel="objects"))
    assert novel.get(0).id == f"{ENV}/{source.dataset.name}/train+objects/4/00000"
