"""Episode files and episode sources."""

import json
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
)
from hab_tasks.errors import EpisodeError, UnknownNameError

ENV = "HabPick-v1"
MADE_FROM = MadeFrom(dataset="0123abcd", objects="embedded", masses="89ef4567", generator=8)
SCENES = ("v3_sc0_staging_00", "apt_0")


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    """Nothing that was generated before is found."""
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))


def random_numbers(rng, count):
    return tuple(rng.normal(size=count).tolist())


def random_pose(rng):
    turn = rng.normal(size=4)
    return (*random_numbers(rng, 3), *(turn / np.linalg.norm(turn)).tolist())


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
        robot=RobotStart(base=random_numbers(rng, 3), arm_qpos_rad=random_numbers(rng, 7)),
        objects={handle: random_pose(rng) for handle in handles},
        targets=tuple(targets),
        held=handles[0] if rng.uniform() < 0.5 else None,
        handle=HandleRef(furniture="f_:0000", joint="j", marker="m") if index % 2 else None,
        navigation=NavigationGoal(skill=ENV, base=random_numbers(rng, 3)) if index % 3 else None,
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
    for suffix in (".json", ".json.gz"):
        for seed in range(4):
            file = tmp_path / f"new{seed}/folder/set{suffix}"
            episodes = random_set(seed, 20 if seed else 0)
            write_episodes(episodes, file)
            assert read_episodes(file) == episodes
            first = file.read_bytes()
            write_episodes(random_set(seed, 20 if seed else 0), file)
            assert file.read_bytes() == first
            file.unlink()
            assert not [*file.parent.iterdir()], "something is left over"
    assert first[4:8] == bytes(4), "gzip's header has the time"


def test_a_refusal_names_the_file_the_episode_and_the_field(tmp_path):
    """`tests/faults/test_episode_files.py` has the malformed values themselves."""
    file = tmp_path / "set.json"
    changes = {
        "episode 'a', field robot": lambda raw: raw["episodes"][3]["robot"].update(base=[0, 1]),
        "field .*env": lambda raw: raw.pop("env"),
        "episode schema 2; .*hab-tasks episodes": lambda raw: raw.update(schema=2),
    }
    write_episodes(random_set(1), file)
    whole = file.read_text()
    for where, change in changes.items():
        raw = json.loads(whole)
        raw["episodes"][3]["id"] = "a"
        change(raw)
        file.write_text(json.dumps(raw))
        with pytest.raises(EpisodeError, match=rf"{re.escape(str(file))}[:,] .*{where}"):
            read_episodes(file)


# Sources ---------------------------------------------------------------------------------------


def test_a_file_serves_its_episodes_and_no_more_and_to_no_other_env(tmp_path, generated):
    source, episodes = generated(ENV)
    pick, file = source.to_set(len(episodes)), tmp_path / "set.json"
    write_episodes(pick, file)
    source = open_source(EpisodeRequest(env_id=ENV, file=file))
    assert source.available == len(pick)
    assert source.get(len(pick) - 1) == pick.episodes[-1]
    for index in (len(pick), -1):
        with pytest.raises(EpisodeError, match=f"valid indices are 0 to {len(pick) - 1}"):
            source.get(index)
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
