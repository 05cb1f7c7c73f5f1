"""One row of a batch starts anew: what the environment does, on tensors, without a simulator."""

import pytest
import torch
from builders import snapshot

from hab_tasks.envs import ENVS
from hab_tasks.measures import Tracker
from hab_tasks.rewards import total
from hab_tasks.sensors import Goals

N, CPU = 3, torch.device("cpu")


def moment(ee_x, held=(-1, -1, -1), force=(0.0, 0.0, 0.0)):
    ee = torch.zeros(N, 3)
    ee[:, 0] = torch.tensor(ee_x)
    objects = torch.tensor([1.0, 0.0, 1.0]).expand(N, 3)
    return snapshot(
        N, ee_m=ee, object_m=objects, held=torch.tensor(held), force_n=torch.tensor(force)
    )


def reward_of(skill, s, m):
    ends = skill.failures(s, m, skill.config)
    ends["success"] = skill.success(s, m, skill.config)
    goals = Goals(object_start_m=torch.zeros(N, 3))
    return total(skill.reward_terms(s, m, goals, skill.config, ends)), ends


@pytest.mark.parametrize("env_id", ENVS)
def test_a_row_that_starts_anew_neither_pays_nor_fails_for_its_past(env_id):
    skill = ENVS[env_id].env.skill
    tracker = Tracker(N, CPU)
    tracker.begin(moment((0.0, 0.0, 0.0)), torch.arange(N))
    spent = moment((0.5, 0.5, 0.5), held=(-1, 1, -1), force=(0.0, 6000.0, 10.0))
    tracker.advance(spent)
    _, ends = reward_of(skill, spent, tracker.measures)
    assert ends["force"].tolist() == [False, True, False]
    assert ends["wrong_object"].tolist() == [False, True, False]
    before = tracker.get_state()

    fresh = moment((0.5, 0.0, 0.5))
    tracker.begin(fresh, torch.tensor([1]))
    reward, ends = reward_of(skill, fresh, tracker.measures)
    assert not any(end[1] for end in ends.values())
    assert reward[1] == 0
    for name, value in tracker.get_state().items():
        assert torch.equal(value[[0, 2]], before[name][[0, 2]]), name

    tracker.advance(moment((0.5, 0.1, 0.5)))
    # Row 1 went from (0, 0, 0) to (0.1, 0, 0); the target is at (1, 0, 1): sqrt 2 - sqrt 1.81.
    expected = 2**0.5 - 1.81**0.5
    decrease = tracker.measures.ee_to_object_decrease_m
    assert torch.allclose(decrease, torch.tensor([0.0, expected, 0.0]), atol=1e-6)
    # The other rows' force goes on adding up.
    assert torch.allclose(tracker.measures.force_total_n, torch.tensor([0.0, 0.0, 10.0]))


@pytest.mark.parametrize("env_id", ENVS)
def test_rows_do_not_influence_each_other(env_id):
    skill = ENVS[env_id].env.skill
    moments = [
        moment((0.0, 0.1, 0.2)),
        moment((0.1, 0.3, 0.2), held=(0, -1, 1), force=(5.0, 0.0, 2000.0)),
        moment((0.2, 0.2, 0.1), held=(0, 0, -1), force=(5.0, 7.0, 0.0)),
    ]
    whole = Tracker(N, CPU)
    whole.begin(moments[0], torch.arange(N))
    for s in moments[1:]:
        whole.advance(s)
    rewards, ends = reward_of(skill, moments[-1], whole.measures)
    for row in range(N):
        alone = Tracker(N, CPU)
        copies = [
            snapshot(N, **{n: v[[row] * N] for n, v in vars(s).items() if v is not None})
            for s in moments
        ]
        alone.begin(copies[0], torch.arange(N))
        for s in copies[1:]:
            alone.advance(s)
        single, single_ends = reward_of(skill, copies[-1], alone.measures)
        assert torch.equal(single, rewards[row].expand(N))
        assert all(torch.equal(single_ends[n], ends[n][row].expand(N)) for n in ends)
