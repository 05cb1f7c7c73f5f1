"""Episode files and episode sources."""

from dataclasses import replace
from pathlib import Path

import pytest

import hab_tasks
from hab_tasks.episodes import (
    Episode,
    EpisodeRequest,
    EpisodeSet,
    load_episodes,
    open_source,
    read_episodes,
    write_episodes,
)
from hab_tasks.episodes.schema import HandleRef, MadeFrom, NavigationGoal, Rearrangement, RobotStart
from hab_tasks.errors import EpisodeError, UnknownNameError

ENV = "HabPick-v1"
POSE = (0.1, -2.0, 1 / 3, 0.6, 0.0, -0.8, 0.0)
BARE = Episode(
    id="a",
    scene_id="apt_0",
    seed=2**31 - 1,
    robot=RobotStart(base=(0.5, 1e-9, -3.1), arm_qpos_rad={"pan": 0.1, "lift": -1e-9}),
    objects={},
    targets=(),
)
FULL = replace(
    BARE,
    id="b",
    objects={"024_bowl_:0000": POSE, "013_apple_:0001": POSE[::-1]},
    targets=(
        Rearrangement(object="024_bowl_:0000", start=("shelf", "rack_:0000/link")),
        Rearrangement(object="013_apple_:0001", goal=("sink", "sink_:0"), world_from_goal=POSE),
    ),
    held="013_apple_:0001",
    handle=HandleRef(furniture="f_:0000", joint="j", marker="m"),
    navigation=NavigationGoal(skill=ENV, base=(1.0, 2.0, 0.3)),
    joints={"a_:0000": {"slide": 0.25, "door": -0.5}},
    loose={"cup_:0000": POSE},
    habitat={"kept": {"a": [1, 2.5, None]}},
)
SET = EpisodeSet(
    env=ENV,
    scene_dataset="apartment",
    split="train",
    seed=3,
    made_from=MadeFrom(dataset="0123abcd", objects="embedded", masses="89ef4567", generator=8),
    episodes=(replace(BARE, loose=FULL.loose), FULL, replace(BARE, id="c", scene_id="v3_sc0")),
    rejections={"a reason": 2},
    habitat={"config": {"x": 1}},
)


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    """Nothing that was generated before is found."""
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))


def test_round_trip(tmp_path):
    for suffix in (".json", ".json.gz"):
        file = tmp_path / f"new/folder/set{suffix}"
        for episodes in (SET, replace(SET, episodes=(), habitat={})):
            write_episodes(episodes, file)
            first = file.read_bytes()
            assert read_episodes(file) == episodes
            write_episodes(read_episodes(file), file)
            assert file.read_bytes() == first
        file.unlink()
        assert not [*file.parent.iterdir()], "something is left over"
    assert first[4:8] == bytes(4), "gzip's header has the time"


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


def test_sets_that_ship_are_of_todays_data_and_generators():
    files = sorted((Path(hab_tasks.__file__).parents[1] / "assets" / "episodes").glob("*.gz"))
    assert len(files) == 17  # validation of ten environments, training of seven skills
    for file in files:
        shipped = read_episodes(file)
        request = EpisodeRequest(env_id=shipped.env, split=shipped.split, seed=shipped.seed)
        source = open_source(request)
        assert source.made_from == shipped.made_from, f"{file.name}: see assets/README.md"
        assert source.holds(len(shipped)), file.name
