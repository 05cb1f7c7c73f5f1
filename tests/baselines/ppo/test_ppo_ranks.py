"""Ranks that learn together: gradients of one process, and preemption of a slow rank."""

import pytest
import torch
from hab_ppo.distributed import Ranks
from ppo_rank import STEPS, gradients, run_ranks

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def two_ranks(tmp_path_factory):
    return run_ranks(2, tmp_path_factory.mktemp("two"), "gradients", "distillation")


def test_gradients_equal_those_of_one_process_on_the_same_data(two_ranks):
    one_rank = gradients(Ranks())
    ranks = [rank["gradients"] for rank in two_ranks]
    for rank in ranks:
        for name, expected in one_rank["gradients"].items():
            torch.testing.assert_close(rank["gradients"][name], expected, atol=1e-6, rtol=0)
        assert rank["metrics"] == ranks[0]["metrics"]
        for name, value in rank["state"].items():
            assert torch.equal(value, ranks[0]["state"][name]), name
            if "normalizer" in name:
                torch.testing.assert_close(value, one_rank["state"][name])
    for name, value in one_rank["metrics"].items():
        assert ranks[0]["metrics"][name] == pytest.approx(value, abs=1e-5)


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


def test_a_slow_rank_is_preempted(tmp_path):
    ranks = [rank["preemption"] for rank in run_ranks(3, tmp_path, "preemption")]
    *fast, slow = [rank["lengths"].tolist() for rank in ranks]
    assert fast == [[STEPS, STEPS]] * 2
    # Two of three are 67 %: the last one stops, but never before a quarter of its rollout.
    assert all(STEPS / 4 <= length < STEPS for length in slow)
    for rank in ranks:
        torch.testing.assert_close(rank["state"], ranks[0]["state"], atol=0, rtol=0)
