"""Start states at raised shelves: as many as said, and none at the height of a held-out shelf."""

import numpy as np
import pytest
from hab_ppo.shelf_starts import APART_M, PICK_ID

from hab_tasks.cli import main
from hab_tasks.episodes import EpisodeRequest, open_source
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.spots import receptacles_named, spot_of
from hab_tasks.receptacles import CABINET, SHELVES, UNSEEN_RECEPTACLES

COUNT = 16


@pytest.mark.slow
def test_half_of_the_starts_are_at_raised_shelves(tmp_path):
    out = tmp_path / "shelves"
    assert (
        main(["vary", "apartment", "--wild", "--shelves", "--count", "2", "--out", str(out)]) == 0
    )
    source = open_source(EpisodeRequest(env_id=PICK_ID, scene_dataset=out, seed=3))
    at_shelves = 0
    for index in range(COUNT):
        episode = source.get(index)
        ref = episode.targets[0].start
        if ref[0] not in CABINET:
            assert ref[0] not in (*SHELVES, UNSEEN_RECEPTACLES[-1])
            continue
        at_shelves += 1
        sandbox = PlacementSandbox(source.scene(episode.scene_id), source.objects)
        heights_m = {
            (one.name, one.body): spot_of(sandbox, one, {}).center_m[2]
            for one in receptacles_named(sandbox, (*CABINET, *SHELVES))
        }
        held_out = [height for (name, _), height in heights_m.items() if name in SHELVES]
        assert np.abs(np.array(held_out) - heights_m[ref]).min() > APART_M
    # Of 16 draws with probability 1/2, fewer than 3 or more than 13 are at shelves in 0.4 %.
    assert 3 <= at_shelves <= 13
