"""Progress in a task: facts, stages, parts."""

from types import SimpleNamespace

import numpy as np
import torch
from builders import goals_of, measures, row, same, snapshot

from hab_tasks.registration import TASKS
from hab_tasks.tasks.base import Facts, compile_task
from hab_tasks.tasks.task_rules import Progress

TIDY_HOUSE, PREPARE_GROCERIES, SET_TABLE = map(compile_task, TASKS.values())

FIRST = 7
"""Index in the grasp of object 0; the others follow."""

CLOSED, OPEN = (0.0, 0.0), (0.3, 2.0)


def make_snapshot(task, *rows):
    """A snapshot of rows (held object or None, placed objects) or with joints as well."""
    count = len(rows)
    points = torch.full((count, task.objects, 3), 5.0)
    held, joints = torch.full((count,), -1), torch.zeros(count, len(task.articulations))
    for i, (holding, placed, *rest) in enumerate(rows):
        points[i, list(placed)] = 0.05  # |(0.05, 0.05, 0.05)| = 0.087 m from the goal, the origin
        if holding is not None:
            held[i] = FIRST + holding
        if rest:
            joints[i] = torch.tensor(rest[0])
    articulations = len(task.articulations)
    return snapshot(count, articulations=articulations, objects_m=points, held=held, joints=joints)


def unfinished(count, **values):
    """Measures with which no skill is done, but for `values`."""
    far = torch.full((count,), 9.0)
    return measures(count, **{"base_to_goal_m": far, "ee_to_rest_m": far, "joint": far, **values})


def tracker_of(targets, moving=()):
    """What progress asks of a tracker: all objects rest, but those of some rows."""
    at_rest = targets >= 0
    at_rest[list(moving)] = False
    return SimpleNamespace(targets=targets, at_rest=lambda: at_rest)


class ProgressHarness:
    """The progress of a batch, advanced with given snapshots."""

    def __init__(self, task, count):
        self.task, self.count = task, count
        upper = {"joint_upper": [(0.3, 2.6)] * count} if task.articulations else {}
        self.goals = goals_of(count, task.objects, len(task.articulations), **upper)
        self.targets = np.tile(np.arange(FIRST, FIRST + task.objects), (count, 1))
        self.tracker = tracker_of(self.targets)
        self.progress = Progress(task, count)
        self.begin(range(count), *[(None, ())] * count)

    def begin(self, rows, *seen):
        shot = make_snapshot(self.task, *seen)
        self.progress.begin(rows, shot, self.goals, self.tracker)

    def see(self, *seen, **values):
        """Advances one control step; returns the reached stages and the success flags."""
        shot = make_snapshot(self.task, *seen)
        m = unfinished(self.count, **values)
        self.progress.advance(shot, m, self.goals, self.tracker)
        return self.progress.stages.tolist(), self.progress.success().tolist()

    def go_to(self, *parts):
        """Sets the current parts of the rows."""
        state = self.progress.get_state() | {"part": torch.tensor(parts)}
        self.restore(state, range(self.count))

    def restore(self, state, rows):
        shot = make_snapshot(self.task, *[(None, ())] * self.count)
        self.progress.set_state(state, rows, shot, self.goals, self.tracker)


# Facts -----------------------------------------------------------------------------------------


def test_facts_by_hand():
    harness = ProgressHarness(SET_TABLE, 6)
    seen = (
        (None, (), CLOSED),
        (0, (0,), OPEN),  # held at its goal: not placed
        (1, (0,), (0.27, 1.5)),  # 0.27 / 0.3 = 90 %; below 90 degrees
        (None, (0, 1), (0.26, 1.6)),  # 87 %; above 90 degrees
        (None, (1,), (0.049, 0.149)),
        (None, (0, 1), OPEN),  # still moving
    )
    facts = Facts(SET_TABLE)
    shot = make_snapshot(SET_TABLE, *seen)
    flags = facts.read(shot, harness.goals, tracker_of(harness.targets, moving=[5]))
    # held bowl, apple; placed bowl, apple; open drawer, fridge; closed drawer, fridge
    assert flags.tolist() == [
        [False, False, False, False, False, False, True, True],
        [True, False, False, False, True, True, False, False],
        [False, True, True, False, True, False, False, False],
        [False, False, True, True, False, True, False, False],
        [False, False, False, True, False, False, True, True],
        [False, False, False, False, True, True, False, False],
    ]


# Stages ----------------------------------------------------------------------------------------


def test_stages_are_reached_in_order_and_for_good():
    harness = ProgressHarness(TIDY_HOUSE, 3)
    nothing = (None, ())
    assert harness.see((0, ()), nothing, nothing)[0] == [1, 0, 0]
    assert harness.see(nothing, (0, ()), nothing)[0] == [1, 1, 0]  # row 0 has dropped it again
    assert harness.see((None, (0,)), nothing, nothing)[0] == [2, 1, 0]
    assert harness.see((1, (0,)), (None, (0,)), nothing)[0] == [3, 2, 0]
    reached = {name: flag.tolist() for name, flag in harness.progress.reached().items()}
    assert list(reached) == list(TIDY_HOUSE.stages)
    assert reached["pick_1"] == [True, True, False]
    assert reached["place_1"] == [True, True, False]
    assert reached["pick_2"] == [True, False, False]
    assert not any(any(reached[f"pick_{n}"]) for n in (3, 4, 5))


def test_later_stages_need_earlier_placements_one_a_step():
    harness = ProgressHarness(PREPARE_GROCERIES, 2)
    harness.see((0, ()), (0, ()))
    harness.see((None, (0,)), (None, (0,)))
    # Row 1 has pushed the first object away from its goal.
    assert harness.see((1, (0,)), (1, ()))[0] == [3, 2]
    assert harness.see((None, (0, 1)), (None, (1,)))[0] == [4, 2]
    assert harness.see((None, (0, 1)), (1, (0,)))[0] == [4, 3]
    # The drawer is open and the bowl in the hand in the same step.
    harness = ProgressHarness(SET_TABLE, 2)
    seen = ((0, (), (0.3, 0.0)), (0, (), (0.1, 0.0)))
    assert harness.see(*seen)[0] == [1, 0]
    assert harness.see(*seen)[0] == [2, 0]


def test_the_goal_is_that_of_the_moment_and_ends_the_stages():
    harness = ProgressHarness(PREPARE_GROCERIES, 2)
    for k in range(3):
        before = tuple(range(k))
        harness.see((k, before), (k, before))
        stages, success = harness.see((None, (*before, k)), (k, (*before, k)))
    assert stages == [6, 5]  # row 1 has not let the last one go
    assert success == [True, False]
    stages, success = harness.see((None, (0, 1)), (None, (0, 1, 2)))
    assert stages == [6, 6]
    assert success == [False, True]
    for _ in range(3):
        stages, success = harness.see((None, (0, 1, 2)), (None, (0, 1, 2)))
    assert stages == [6, 6]
    assert success == [True, True]


def test_a_doors_state_counts_for_the_goal():
    harness = ProgressHarness(SET_TABLE, 4)
    both = (None, (0, 1))
    success = harness.see((*both, CLOSED), (*both, (0.06, 0.0)), (*both, (0.0, 0.16)), both)[1]
    assert success == [True, False, False, True]


# Parts -----------------------------------------------------------------------------------------


def test_a_part_ends_when_its_own_skill_is_done():
    harness = ProgressHarness(TIDY_HOUSE, 4)
    # Rows 0 and 3 navigate, row 1 picks, row 2 places; all have arrived and hold their object at
    # rest, but for row 3.
    harness.go_to(0, 1, 3, 2)
    values = {
        "base_to_goal_m": row(0.1, 0.1, 0.1, 0.4),
        "holding_target": row(True, True, True, True),
        "ee_to_rest_m": row(0.1, 0.1, 0.1, 0.1),
    }
    harness.see(*[(None, ())] * 4, **values)
    assert harness.progress.done.tolist() == [True, True, False, False]
    assert harness.progress.part.tolist() == [0, 1, 3, 2], "the next part begins with the next step"
    assert harness.progress.move_on() == [0, 1]
    assert harness.progress.part.tolist() == [1, 2, 3, 2]
    assert not harness.progress.done.any()
    assert harness.progress.move_on() == []
    harness.see(*[(None, ())] * 4, **values | {"placed": row(False, False, True, True)})
    # Row 0 picks now, row 1 has arrived already, row 2 has placed; row 3 has not arrived.
    assert harness.progress.done.tolist() == [True, True, True, False]


def test_the_last_part_stays_and_succeeds_in_one_step_only():
    last = len(TIDY_HOUSE.parts) - 1
    harness = ProgressHarness(TIDY_HOUSE, 2)
    harness.go_to(last, 0)
    placed = {"placed": row(True, True), "ee_to_rest_m": row(0.0, 0.0)}
    succeeded = []
    for _ in range(3):
        assert harness.progress.move_on() == []
        harness.see((None, (4,)), (None, ()), **placed)
        succeeded.append(harness.progress.succeeded.tolist())
    assert succeeded == [[True, False], [False, False], [False, False]]
    assert harness.progress.part.tolist() == [last, 0]


# Some rows, save and restore -------------------------------------------------------------------


def advanced(count=4):
    harness = ProgressHarness(TIDY_HOUSE, count)
    harness.go_to(*range(1, count + 1))
    harness.see(
        *[(0, ())] * count, holding_target=row(*[True] * count), ee_to_rest_m=row(*[0.0] * 4)
    )
    return harness


def test_a_restored_state_goes_on_alike_and_leaves_other_rows():
    harness, other = advanced(), ProgressHarness(TIDY_HOUSE, 4)
    rows = [3, 1]
    state = harness.progress.get_state()
    kept = {name: value.clone() for name, value in state.items()}
    untouched = other.progress.get_state()
    other.restore({name: value[rows] for name, value in state.items()}, rows)
    for name, value in other.progress.get_state().items():
        assert np.array_equal(value[rows], state[name][rows]), name
        assert np.array_equal(value[[0, 2]], untouched[name][[0, 2]]), name
    other.restore(state, range(4))
    for b in (harness, other):
        b.progress.move_on()
        b.see(*[(None, (0,))] * 4)
    assert same(other.progress.get_state(), harness.progress.get_state())
    assert same(state, kept), "a saved state changed with the progress"
    assert not same(harness.progress.get_state(), state)
