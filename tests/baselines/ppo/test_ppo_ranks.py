"""Ranks that learn together: gradients of one process, and preemption of a slow rank."""

from concurrent.futures import ThreadPoolExecutor

import pytest
import torch
from hab_ppo.distributed import Ranks, common_name
from ppo_rank import STEPS, gradients, run_ranks


@pytest.fixture(scope="module")
def two_ranks(tmp_path_factory):
    return run_ranks(2, tmp_path_factory.mktemp("two"), "gradients", "distillation")


@pytest.mark.slow
def test_gradients_equal_those_of_one_process_on_the_same_data(two_ranks):
    one_rank = gradients(Ranks())
    ranks = [rank["gradients"] for rank in two_ranks]
    for rank in ranks:
        for name, expected in one_rank["gradients"].items():
            gap = (rank["gradients"][name] - expected).abs().max()
            assert gap <= 1e-6, (name, gap)
        assert rank["metrics"] == ranks[0]["metrics"]
        for name, value in rank["state"].items():
            assert torch.equal(value, ranks[0]["state"][name]), name
            if "normalizer" in name:
                torch.testing.assert_close(value, one_rank["state"][name])
    for name, value in one_rank["metrics"].items():
        assert ranks[0]["metrics"][name] == pytest.approx(value, abs=1e-5)


@pytest.mark.slow
def test_the_first_rank_learns_from_what_all_visit(two_ranks):
    first, second = (rank["distillation"] for rank in two_ranks)
    # 150 steps a round in each rank; the last step of 8 rows may bring 7 more than it takes.
    once, twice = first["rounds"]
    assert 300 <= once <= 314
    assert 600 <= twice <= 628
    assert (second["rounds"], second["steps"]) == ([], [])
    assert 10 <= first["steps"][0] <= 17
    assert 20 <= first["steps"][1] <= 27
    (start,), (_, *rounds) = second["kept"], first["kept"]
    for name, value in second["state"].items():
        assert torch.equal(value, rounds[0][name]), name  # the weights of the last round's visits
    assert not torch.equal(start["actor.0.weight"], rounds[0]["actor.0.weight"])


@pytest.mark.slow
def test_a_slow_rank_is_preempted(tmp_path):
    ranks = [rank["preemption"] for rank in run_ranks(3, tmp_path, "preemption")]
    *fast, slow = [rank["lengths"].tolist() for rank in ranks]
    assert fast == [[STEPS, STEPS]] * 2
    # Two of three are 67 %: the last one stops, but never before a quarter of its rollout.
    assert all(STEPS / 4 <= length < STEPS for length in slow)
    for rank in ranks:
        for name, value in rank["state"].items():
            assert torch.equal(value, ranks[0]["state"][name]), name


def test_ranks_agree_on_a_name_that_killed_ranks_have_not_had():
    store = torch.distributed.HashStore()
    store.set("asks/1", "killed")
    names = []
    with ThreadPoolExecutor(3) as pool:
        for _ in range(2):  # a restart finds the keys of the ranks before
            found = list(pool.map(lambda rank: common_name(store, rank, 3), range(3)))
            assert len(set(found)) == 1
            names += found[:1]
    assert len({*names, "killed"}) == 3
