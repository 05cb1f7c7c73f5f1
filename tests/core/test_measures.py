"""Measures of a tracker on batches of hand-made snapshots, and the transform to the base frame."""

import math
from dataclasses import replace

import numpy as np
import torch
from builders import StraightWays, goals_of, snapshot

from hab_tasks.constants import REST_POSITION_M
from hab_tasks.engine.measures import MEANINGS, Tracker

N = 4
ALL = range(N)
GOING, STOPPED = np.zeros(N, dtype=bool), np.ones(N, dtype=bool)
REST = torch.tensor(REST_POSITION_M)


def goals(articulations=0, **values):
    return goals_of(N, 1, articulations, **values)


def tracker_at(first, goals=None, geodesic=None):
    """A tracker whose row 0 is about object 0, row 1 about object 1 and so on."""
    tracker = Tracker(goals or goals_of(N, 1, first.joints.shape[1]), geodesic)
    tracker.targets = np.arange(N)[:, None]
    tracker.begin(first, ALL)
    return tracker


def random_snapshot(seed, held=(-1, -1, -1, -1)):
    generator = torch.Generator().manual_seed(seed)
    draw = {name: torch.randn(N, 3, generator=generator) for name in ("base", "ee_m")}
    objects_m = torch.randn(N, 1, 3, generator=generator)
    force_n = torch.rand(N, generator=generator) * 100
    return snapshot(N, **draw, objects_m=objects_m, held=torch.tensor(held), force_n=force_n)


def test_distances_of_the_first_moment():
    ee = torch.stack([REST, REST + torch.tensor([0.3, 0.4, 0.0]), REST, REST])
    objects = ee + torch.tensor([[0.0, 0, 0], [0, 0, 0.25], [1, 2, 2], [-0.6, 0.8, 0]])
    goals_m = objects + torch.tensor([[0.0, 0, 2], [0, 0.3, 0.4], [0, 0, 0], [2, -1, 2]])
    handles = ee - torch.tensor([[0.0, 0, 0.5], [4, 0, 3], [0, 0, 0], [2, 3, 6]])
    first = snapshot(
        N, articulations=1, ee_m=ee, objects_m=objects[:, None], handles_m=handles[:, None]
    )
    m = tracker_at(first, goals(articulations=1, goals_m=goals_m[:, None])).measures
    # |(0.3, 0.4, 0)| = 0.5; |(1, 2, 2)| = 3; |(-0.6, 0.8, 0)| = 1
    assert np.allclose(m.ee_to_rest_m, torch.tensor([0.0, 0.5, 0.0, 0.0]), atol=1e-6)
    assert np.allclose(m.ee_to_object_m, torch.tensor([0.0, 0.25, 3.0, 1.0]), atol=1e-6)
    # |(0, 0.3, 0.4)| = 0.5; |(2, -1, 2)| = 3; |(4, 0, 3)| = 5; |(2, 3, 6)| = 7
    assert np.allclose(m.object_to_goal_m, torch.tensor([2.0, 0.5, 0.0, 3.0]), atol=1e-6)
    assert np.allclose(m.ee_to_handle_m, torch.tensor([0.5, 5.0, 0.0, 7.0]), atol=1e-6)
    assert np.array_equal(m.ee_to_object_start_m, m.ee_to_object_m)
    for name in MEANINGS:
        if name.endswith(("_decrease_m", "_decrease_rad", "_increase", "_now")):
            assert not getattr(m, name).any(), name


def test_advance_takes_differences_and_sums_the_force():
    first, second = random_snapshot(0), random_snapshot(1)
    tracker = tracker_at(first)
    before = tracker.measures
    tracker.advance(second, GOING)
    now = tracker.measures
    gap = np.linalg.norm(second.objects_m[:, 0] - second.ee_m, axis=1)
    assert np.allclose(now.ee_to_object_m, gap)
    assert np.allclose(now.ee_to_object_decrease_m, before.ee_to_object_m - gap)
    for name in ("ee_to_rest", "object_to_goal"):
        change = getattr(before, f"{name}_m") - getattr(now, f"{name}_m")
        assert np.allclose(getattr(now, f"{name}_decrease_m"), change), name
    assert np.allclose(now.force_n, second.force_n)
    assert np.allclose(now.force_total_n, first.force_n + second.force_n)
    assert np.array_equal(now.ee_to_object_start_m, before.ee_to_object_m)
    tracker.advance(second, STOPPED)
    assert not tracker.measures.ee_to_object_decrease_m.any()
    assert np.allclose(tracker.measures.force_total_n, first.force_n + 2 * second.force_n)
    assert tracker.measures.steps.tolist() == [2.0] * N
    assert now.stopped.tolist() == [False] * N
    assert tracker.measures.stopped.tolist() == [True] * N


def test_picking_up_and_dropping():
    # Row 1's target is object 1; the other rows hold nothing.
    for before, after, picked, dropped, other, picked_other in (
        (-1, 1, True, False, False, False),  # the target
        (-1, 0, False, False, True, True),  # another object
        (1, 1, False, False, False, False),
        (0, 0, False, False, True, False),
        (1, -1, False, True, False, False),
        (1, 0, False, True, True, True),  # exchanged for another
        (0, 1, True, False, False, False),
        (-1, -1, False, False, False, False),
    ):
        tracker = tracker_at(random_snapshot(0, (-1, before, -1, -1)))
        tracker.advance(random_snapshot(1, (-1, after, -1, -1)), GOING)
        m = tracker.measures
        found = (m.picked_now, m.dropped_now, m.holding_other, m.picked_other_now, m.holding_target)
        for flags, flag in zip(
            found, (picked, dropped, other, picked_other, after == 1), strict=True
        ):
            assert flags.tolist() == [False, flag, False, False], (before, after)


def test_placed_means_within_15_cm_and_let_go():
    heights = torch.tensor([0.149, 0.151, 0.1, 0.1])
    at = torch.stack((torch.zeros(N), torch.zeros(N), heights), dim=1)[:, None]
    held = torch.tensor([-1, -1, 2, 0])  # row 2 holds its own object, row 3 another one
    m = tracker_at(snapshot(N, objects_m=at, held=held), goals()).measures
    assert m.placed.tolist() == [True, False, False, True]


def test_a_door_and_its_handle():
    travel = {"joint_lower": torch.full((N, 1), -0.5), "joint_upper": torch.full((N, 1), 1.5)}
    first = snapshot(N, joints=torch.tensor([[-0.5], [0.5], [1.0], [1.5]]), articulations=1)
    tracker = tracker_at(first, goals(articulations=1, **travel))
    tracker.handles[:] = torch.tensor([[0], [1], [2], [3]])
    # (0.5 + 0.5) / 2 = 0.5; (1 + 0.5) / 2 = 0.75
    assert tracker.measures.joint_share.tolist() == [0.0, 0.5, 0.75, 1.0]
    moved = replace(
        first, joints=np.array([[-0.25], [0.0], [1.0], [1.5]]), held_handle=np.array([0, 0, -1, 3])
    )
    tracker.advance(moved, GOING)
    m = tracker.measures
    assert m.joint_increase.tolist() == [0.25, -0.5, 0.0, 0.0]
    assert m.joint.tolist() == [-0.25, 0.0, 1.0, 1.5]
    # Row 1 holds the handle of another door.
    assert m.holding_handle.tolist() == [True, False, False, True]
    assert m.grabbed_now.tolist() == [True, False, False, True]


def test_way_and_heading_of_the_base():
    base = torch.tensor([[3.0, 4, 0.1], [0, 2, 3.0], [1, 0, -3.0], [0, 0, 1.0]])
    asked = torch.tensor([[0.0, 0, -0.2], [0, 0, -3.0], [0, 0, 3.0], [0, 0, 1.0]])
    tracker = tracker_at(snapshot(N, base=base), goals(base=asked), StraightWays())
    m = tracker.measures
    assert m.base_to_goal_m.tolist() == [5.0, 2.0, 1.0, 0.0]
    assert np.array_equal(m.base_to_goal_start_m, m.base_to_goal_m)
    # 0.1 + 0.2 = 0.3; 3 + 3 = 6 is 2 pi - 6 = 0.2832 the other way round, in both directions
    apart = torch.tensor([0.3, 2 * math.pi - 6, 2 * math.pi - 6, 0.0])
    assert np.allclose(m.heading_error_rad, apart, atol=1e-6)
    assert m.path_m.tolist() == [0.0] * N
    there = torch.tensor([[0.0, 0, 0.0], [0, 2, -3.0], [1, 1, -3.0], [0, 0, 1.0]])
    tracker.advance(snapshot(N, base=there), GOING)
    m = tracker.measures
    # Row 2 goes from 1 m to sqrt(2) m away.
    decrease = torch.tensor([5.0, 0.0, 1 - math.sqrt(2), 0.0])
    assert np.allclose(m.base_to_goal_decrease_m, decrease)
    turned = torch.tensor([0.1, 2 * math.pi - 6, 0.0, 0.0])  # 0.3 - 0.2 = 0.1
    assert np.allclose(m.heading_error_decrease_rad, turned, atol=1e-6)
    assert m.path_m.tolist() == [5.0, 0.0, 1.0, 0.0]
    tracker.advance(snapshot(N, base=base), GOING)
    assert tracker.measures.path_m.tolist() == [10.0, 0.0, 2.0, 0.0]
    assert tracker.measures.base_to_goal_start_m.tolist() == [5.0, 2.0, 1.0, 0.0]
