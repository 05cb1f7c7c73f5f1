"""The tracker on batches of hand-made snapshots, and the change to the base frame."""

import math
from dataclasses import fields

import pytest
import torch
from builders import same, snapshot

from hab_tasks.constants import REST_POSITION_M
from hab_tasks.measures import Measures, Tracker
from hab_tasks.snapshot import world_to_base

N = 4
ALL = torch.arange(N)
TARGET = torch.tensor([0, 1, 2, 3])


def random_snapshot(seed, held=(-1, -1, -1, -1)):
    generator = torch.Generator().manual_seed(seed)
    draw = {n: torch.randn(N, 3, generator=generator) for n in ("base", "ee_m", "object_m")}
    force = torch.rand(N, generator=generator) * 100
    return snapshot(N, **draw, held=torch.tensor(held), force_n=force)


def tracker_at(first):
    tracker = Tracker(N, torch.device("cpu"))
    tracker.target = TARGET.clone()
    tracker.begin(first, ALL)
    return tracker


def values(tracker):
    return {f.name: getattr(tracker.measures, f.name) for f in fields(Measures)}


def test_world_to_base_by_hand():
    # Base at (1, 2), turned 90 degrees: the world's +y is ahead, the world's -x is left.
    base = torch.tensor(
        [[1.0, 2.0, math.pi / 2], [0.0, 0.0, 0.0], [1.0, 0.0, math.pi], [0, 0, 0.3]]
    )
    points = torch.tensor([[1.0, 5.0, 0.7], [1.0, 2.0, 3.0], [0.0, 2.0, 1.0], [0.0, 0.0, 0.5]])
    # Row 0: 3 m ahead. Row 1: unchanged. Row 2: (-1, 2) turned by 180 degrees is (1, -2).
    expected = torch.tensor([[3.0, 0.0, 0.7], [1.0, 2.0, 3.0], [1.0, -2.0, 1.0], [0.0, 0.0, 0.5]])
    assert torch.allclose(world_to_base(base, points), expected, atol=1e-6)


def test_distances_of_the_first_moment():
    rest = torch.tensor(REST_POSITION_M)
    ee = torch.stack([rest, rest + torch.tensor([0.3, 0.4, 0.0]), rest, rest])
    objects = ee + torch.tensor([[0.0, 0, 0], [0, 0, 0.25], [1, 2, 2], [-0.6, 0.8, 0]])
    m = tracker_at(snapshot(N, ee_m=ee, object_m=objects)).measures
    # |(0.3, 0.4, 0)| = 0.5; |(1, 2, 2)| = 3; |(-0.6, 0.8, 0)| = 1
    assert torch.allclose(m.ee_to_rest_m, torch.tensor([0.0, 0.5, 0.0, 0.0]), atol=1e-6)
    assert torch.allclose(m.ee_to_object_m, torch.tensor([0.0, 0.25, 3.0, 1.0]), atol=1e-6)
    assert not m.ee_to_object_decrease_m.any()
    assert not m.ee_to_rest_decrease_m.any()


def test_advance_takes_differences_and_sums_the_force():
    first, second = random_snapshot(0), random_snapshot(1)
    tracker = tracker_at(first)
    before = tracker.measures
    tracker.advance(second)
    now = tracker.measures
    gap = torch.linalg.norm(second.object_m - second.ee_m, dim=1)
    assert torch.allclose(now.ee_to_object_m, gap)
    assert torch.allclose(now.ee_to_object_decrease_m, before.ee_to_object_m - gap)
    assert torch.allclose(now.ee_to_rest_decrease_m, before.ee_to_rest_m - now.ee_to_rest_m)
    assert torch.allclose(now.force_n, second.force_n)
    assert torch.allclose(now.force_total_n, first.force_n + second.force_n)
    tracker.advance(second)
    assert not tracker.measures.ee_to_object_decrease_m.any()
    assert torch.allclose(tracker.measures.force_total_n, first.force_n + 2 * second.force_n)


@pytest.mark.parametrize(
    ("before", "after", "picked", "dropped", "other"),
    [
        (-1, 1, True, False, False),  # the target
        (-1, 0, False, False, True),  # another object
        (1, 1, False, False, False),
        (1, -1, False, True, False),
        (1, 0, False, True, True),  # exchanged for another
        (0, 1, True, False, False),
        (-1, -1, False, False, False),
    ],
)
def test_picking_up_and_dropping(before, after, picked, dropped, other):
    # Row 1's target is object 1; the other rows hold nothing.
    tracker = tracker_at(random_snapshot(0, (-1, before, -1, -1)))
    tracker.advance(random_snapshot(1, (-1, after, -1, -1)))
    m = tracker.measures
    assert m.picked_now.tolist() == [False, picked, False, False]
    assert m.dropped_now.tolist() == [False, dropped, False, False]
    assert m.holding_other.tolist() == [False, other, False, False]
    assert m.holding_target.tolist() == [False, after == 1, False, False]


def test_a_partial_begin_changes_only_its_rows():
    tracker = tracker_at(random_snapshot(0))
    tracker.advance(random_snapshot(1, (0, 0, -1, 3)))
    before = {name: value.clone() for name, value in values(tracker).items()}
    fresh = random_snapshot(2)
    tracker.begin(fresh, torch.tensor([1, 3]))
    alone = tracker_at(fresh)
    for name, value in values(tracker).items():
        assert torch.equal(value[[0, 2]], before[name][[0, 2]]), name
        assert torch.equal(value[[1, 3]], values(alone)[name][[1, 3]]), name
    assert before["force_total_n"][1] != tracker.measures.force_total_n[1]


def test_state_round_trip_goes_on_alike():
    tracker = tracker_at(random_snapshot(0))
    tracker.advance(random_snapshot(1, (0, -1, 1, 3)))
    state = tracker.get_state()
    other = tracker_at(random_snapshot(5))
    other.target = torch.zeros(N, dtype=torch.long)
    other.set_state(state, ALL)
    assert same(other.get_state(), state)
    for t in (tracker, other):
        t.advance(random_snapshot(2, (-1, 1, 1, 3)))
    assert same(other.get_state(), tracker.get_state())


def test_restoring_some_rows_leaves_the_others():
    tracker = tracker_at(random_snapshot(0))
    tracker.advance(random_snapshot(1, (0, -1, 1, 3)))
    rows = torch.tensor([2, 0])
    state = {name: value[rows] for name, value in tracker.get_state().items()}
    other = tracker_at(random_snapshot(5))
    untouched = other.get_state()
    other.set_state(state, rows)
    for name, value in other.get_state().items():
        assert torch.equal(value[rows], state[name]), name
        assert torch.equal(value[[1, 3]], untouched[name][[1, 3]]), name


def test_a_saved_state_does_not_change_with_the_tracker():
    tracker = tracker_at(random_snapshot(0))
    state = tracker.get_state()
    kept = {name: value.clone() for name, value in state.items()}
    tracker.advance(random_snapshot(1))
    tracker.target[0] = 3
    assert same(state, kept)


def test_info_names_every_scalar_measure():
    scalars = tracker_at(random_snapshot(0)).measures.as_dict()
    assert set(scalars) == {f.name for f in fields(Measures)} - {"ee_in_base_m"}
    assert all(value.shape == (N,) for value in scalars.values())
