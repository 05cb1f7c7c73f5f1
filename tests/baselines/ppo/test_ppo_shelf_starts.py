"""Start states at raised shelves: as many as said, and none at the height of a held-out shelf."""

import subprocess
import sys

import numpy as np
import pytest

from hab_tasks.cli import main
from hab_tasks.episodes import EpisodeRequest, open_source
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import read_episodes
from hab_tasks.episodes.spots import receptacles_named, spot_of
from hab_tasks.receptacles import CABINET, CHAIR, SHELVES

COUNT = 16
ENV = "hab_ppo.shelf_starts:PickOftenFromShelves-v1"
"""Not imported here: the tests of all environments would find it."""


@pytest.mark.slow
def test_half_of_the_starts_are_at_raised_shelves(tmp_path):
    out, file = tmp_path / "shelves", tmp_path / "starts.json"
    assert (
        main(["vary", "apartment", "--wild", "--shelves", "--count", "2", "--out", str(out)]) == 0
    )
    options = ["--scene-dataset", str(out), "--count", str(COUNT), "--seed", "3"]
    command = [sys.executable, "-m", "hab_tasks", "episodes", "--env", ENV, *options]
    subprocess.run([*command, "--out", str(file)], check=True)
    source = open_source(EpisodeRequest(env_id="HabPick-v1", scene_dataset=out))
    at_shelves = 0
    for episode in read_episodes(file).episodes:
        ref = episode.targets[0].start
        assert ref[0] not in (*SHELVES, CHAIR)
        if ref[0] not in CABINET:
            continue
        at_shelves += 1
        sandbox = PlacementSandbox(source.scene(episode.scene_id), source.objects)
        heights_m = {
            (one.name, one.body): spot_of(sandbox, one, {}).center_m[2]
            for one in receptacles_named(sandbox, (*CABINET, *SHELVES))
        }
        held_out = [height for (name, _), height in heights_m.items() if name in SHELVES]
        assert np.abs(np.array(held_out) - heights_m[ref]).min() > 0.05
    # Of 16 draws with probability 1/2, fewer than 3 or more than 13 are at shelves in 0.4 %.
    assert 3 <= at_shelves <= 13
