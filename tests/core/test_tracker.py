"""State of the tracker: latched flags, change of focus, partial resets, save and restore."""

import numpy as np
import pytest
import torch
from builders import StraightWays, goals_of, measures, row, same, snapshot

from hab_tasks.engine.measures import Focus, Tracker
from hab_tasks.skills.pick import PICK
from hab_tasks.skills.place import PLACE

N, K, J = 4, 5, 2
ALL, GOING = range(N), np.zeros(N, dtype=bool)
SOME, OTHERS = [1, 3], [0, 2]


def random_snapshot(seed, **values):
    """Each row may hold one of its objects; the targets are the grasp's objects 10 to 14."""
    rng = torch.Generator().manual_seed(seed)
    shapes = {"base": (N, 3), "ee_m": (N, 3), "objects_m": (N, K, 3), "handles_m": (N, J, 3)}
    draw = {name: 0.2 * torch.randn(*shape, generator=rng) for name, shape in shapes.items()}
    draw["joints"] = torch.rand(N, J, generator=rng)
    draw["held"] = torch.randint(9, 10 + K, (N,), generator=rng)
    draw["held_handle"] = torch.randint(-1, J, (N,), generator=rng)
    draw["force_n"] = 100 * torch.rand(N, generator=rng)
    return snapshot(N, **{**draw, **values})


def tracker_at(first):
    rng = torch.Generator().manual_seed(99)
    goals = goals_of(N, K, J, goals_m=0.2 * torch.randn(N, K, 3, generator=rng))
    tracker = Tracker(goals, StraightWays())
    tracker.targets = np.tile(np.arange(10, 10 + K), (N, 1))
    tracker.handles = np.tile(np.arange(J), (N, 1))
    tracker.begin(first, ALL)
    return tracker


def on(objects, articulations):
    return Focus(object=np.array(objects), articulation=np.array(articulations))


def travelled():
    """A tracker some steps into its episodes, on different objects and articulations."""
    tracker = tracker_at(random_snapshot(0))
    tracker.refocus(random_snapshot(0), ALL, on([0, 1, 4, 2], [0, 1, 1, 0]))
    for seed in (1, 2):
        tracker.advance(random_snapshot(seed), GOING)
    return tracker


def test_each_row_measures_its_own_object_and_articulation():
    tracker = tracker_at(random_snapshot(0))
    objects, articulations = [4, 0, 2, 3], [1, 0, 0, 1]
    shot = random_snapshot(0, held=torch.tensor([14, 14, 12, -1]))
    tracker.refocus(shot, ALL, on(objects, articulations))
    m, goals = tracker.measures, tracker.goals
    for number in range(N):
        point = shot.objects_m[number, objects[number]]
        handle = shot.handles_m[number, articulations[number]]
        goal = goals.goals_m[number, objects[number]]
        assert np.allclose(m.ee_to_object_m[number], np.linalg.norm(point - shot.ee_m[number]))
        assert np.allclose(m.object_to_goal_m[number], np.linalg.norm(point - goal))
        assert np.allclose(m.ee_to_handle_m[number], np.linalg.norm(handle - shot.ee_m[number]))
        assert m.joint[number] == shot.joints[number, articulations[number]]
    assert m.holding_target.tolist() == [True, False, True, False]
    assert m.holding_other.tolist() == [False, True, False, False]
    assert tracker.target().tolist() == [14, 10, 12, 13]


def test_a_new_focus_keeps_what_was_counted_and_is_no_change_of_distance():
    tracker = travelled()
    before, shot = tracker.measures, random_snapshot(2)
    tracker.refocus(shot, SOME, on([3] * N, [1] * N))
    after = tracker.measures
    starts = ("ee_to_object_start_m", "base_to_goal_start_m")
    for name in ("force_total_n", "steps", "path_m", "stopped", *starts):
        assert np.array_equal(getattr(after, name), getattr(before, name)), name
    # Only the chosen rows turned.
    assert tracker.focus.object.tolist() == [0, 3, 4, 3]
    assert tracker.focus.articulation.tolist() == [0, 1, 1, 1]
    changed = after.ee_to_object_decrease_m
    assert np.array_equal(changed[OTHERS], before.ee_to_object_decrease_m[OTHERS])
    assert not changed[SOME].any()
    tracker.advance(shot, GOING)
    m = tracker.measures
    assert not m.ee_to_object_decrease_m.any()
    assert not m.joint_increase.any()
    assert not m.picked_now.any()
    assert m.steps.tolist() == [3.0] * N


def test_what_the_new_object_has_not_done_is_forgotten():
    at_goal = snapshot(N, objects=K, articulations=J, held_handle=torch.zeros(N, dtype=torch.long))
    tracker = tracker_at(snapshot(N, objects=K, articulations=J))
    tracker.goals = goals_of(N, K, J)
    for _ in range(2):
        tracker.advance(at_goal, GOING)
    both = (tracker.measures.placed_before, tracker.measures.grabbed_before)
    assert all(flags.all() for flags in both)
    tracker.refocus(at_goal, SOME, on([1] * N, [1] * N))
    assert tracker.measures.placed_before.tolist() == [True, False, True, False]
    assert tracker.measures.grabbed_before.tolist() == [True, False, True, False]


def test_placed_is_at_rest_for_ten_steps_and_placed_before_stays():
    # Row 0: gets to the goal in step 1, rests from step 11 on, is taken away in step 12. Row 1
    # starts there, row 2 moves there by 2 mm a step, 6 cm/s.
    tracker = Tracker(goals_of(3, 1, 0))
    tracker.targets += 7
    for step in range(14):
        points = torch.zeros(3, 1, 3)
        points[:, 0, 2] = torch.tensor([0.1 if 0 < step < 12 else 0.5, 0.1, 0.002 * step])
        shot = snapshot(3, objects_m=points)
        tracker.advance(shot, GOING[:3]) if step else tracker.begin(shot, ALL[:3])
        m = tracker.measures
        assert m.released.tolist() == [0 < step < 12, True, True]
        assert m.placed.tolist() == [step == 11, True, step == 0]
    assert m.placed_before.tolist() == [True, True, True]


def test_what_a_drop_takes_back():
    # Hand 0.3 m from rest, grasped in step 1 on the way to 0.2 m, dropped in step 3 from 0.1 m.
    tracker, seen = Tracker(goals_of(1, 1, 0)), []
    for step, (gap_m, held) in enumerate(((0.3, -1), (0.2, 0), (0.1, 0), (0.1, -1), (0.1, -1))):
        ee = torch.tensor([[0.5, 0.0, 1.0 - gap_m]])
        shot = snapshot(1, ee_in_base_m=ee, held=torch.tensor([held]))
        tracker.advance(shot, GOING[:1]) if step else tracker.begin(shot, ALL[:1])
        m = tracker.measures
        seen.append((m.dropped_now.item(), round(m.ee_to_rest_gain_m.item(), 6)))
    assert seen == [(False, 0.0), (False, 0.0), (False, 0.1), (True, 0.2), (False, 0.0)]
    # 5 for the grasp and 20 * 0.2 for the way.
    last = measures(1, dropped_now=row(True), ee_to_rest_gain_m=row(0.2))
    assert PICK.taken_back(last, PICK.config).item() == pytest.approx(9.0)
    # Another grasp during Place: the hand got 0.3 m closer to rest, the object 0.1 m away.
    again = measures(
        1, picked_now=row(True), ee_to_rest_gain_m=row(0.3), object_to_goal_gain_m=row(-0.1)
    )
    assert PLACE.taken_back(again, PLACE.config).item() == pytest.approx(20 * 0.4)


def test_a_handle_is_grabbed_for_the_first_time_once():
    tracker = Tracker(goals_of(N, 1, 1))
    # Row 0 lets go and grasps again, row 1 starts with it in the hand, row 2 takes another, row 3
    # none.
    holds = [[-1, 0, 2, -1], [0, 0, -1, -1], [-1, 0, 2, -1], [0, -1, 2, -1], [0, 0, -1, -1]]
    seen = []
    for step, held in enumerate(holds):
        shot = snapshot(N, articulations=1, held_handle=torch.tensor(held))
        tracker.advance(shot, GOING) if step else tracker.begin(shot, ALL)
        seen.append(tracker.measures.grabbed_now.tolist())
    nobody = [False] * N
    assert seen == [nobody, [True, False, False, False], nobody, nobody, nobody]
    assert tracker.measures.grabbed_before.tolist() == [True, True, False, False]


def test_a_restored_tracker_goes_on_alike_and_leaves_other_rows():
    tracker = travelled()
    state = tracker.get_state()
    kept = {name: value.clone() for name, value in state.items()}
    other = tracker_at(random_snapshot(7))
    other.targets, other.handles = other.targets * 0, other.handles * 0
    untouched, rows = other.get_state(), [2, 0]
    other.set_state({name: value[rows] for name, value in state.items()}, rows)
    for name, value in other.get_state().items():
        assert np.array_equal(value[rows], state[name][rows]), name
        assert np.array_equal(value[SOME], untouched[name][SOME]), name
    other.set_state(state, ALL)
    assert same(other.get_state(), state)
    for t in (tracker, other):
        t.advance(random_snapshot(3), ~GOING)
    assert same(other.get_state(), tracker.get_state())
    tracker.targets[0] = 3
    tracker.refocus(random_snapshot(4), ALL, on([1] * N, [1] * N))
    assert same(state, kept), "a saved state changed with the tracker"
