"""Reward of tasks: that of the current skill (App. H.3), on hand-made rows."""

import numpy as np
import pytest
import torch
from builders import row
from rules_harness import FIRST, RulesHarness

from hab_tasks.tasks.benchmark import SET_TABLE, TIDY_HOUSE
from hab_tasks.tasks.task_env import env_class

HabSetTableEnv, HabTidyHouseEnv = env_class(SET_TABLE), env_class(TIDY_HOUSE)

NAVIGATE, PICK, GO_ON, PLACE = range(4)
"""The first parts of TidyHouse."""


def paid(found, index):
    """The terms that a row is paid, without those that are zero."""
    values = {name: float(term[index]) for name, term in found["reward_terms"].items()}
    return {name: pytest.approx(value, abs=1e-5) for name, value in values.items() if value}


def bases(*places):
    return torch.tensor([[x, y, 0.0] for x, y in places])


def held(*objects):
    return torch.tensor([-1 if k is None else FIRST + k for k in objects])


def test_each_row_is_paid_by_the_skill_that_it_does():
    harness = RulesHarness(HabTidyHouseEnv, 3)
    base = bases((9, 0), (1, 0), (1, 0))
    # Hands 0.5 m beside the objects' starts at (1, 0, 1); row 2 carries object 0.
    ee = torch.tensor([[1.0, 0.5, 1.0], [1.0, 0.5, 1.0], [1.0, 3.0, 1.0]])
    points = harness.snapshot().objects_m
    points[2, 0] = torch.tensor([1.0, 3.0, 1.0])
    first = harness.snapshot(base=base, ee_m=ee, objects_m=points, held=held(None, None, 0))
    harness.begin(first, NAVIGATE, PICK, PLACE)
    points = points.copy()
    points[2, 0, 1] = 3.02
    ee = torch.tensor([[1.0, 0.4, 1.0], [1.0, 0.49, 1.0], [1.0, 3.02, 1.0]])
    base = bases((8.98, 0), (1.01, 0), (1, 0))
    after = {"ee_m": ee, "objects_m": points, "held": held(None, None, 0)}
    found = harness.step(harness.snapshot(base=base, **after))
    # Row 0 drives 2 cm nearer to the origin: 20 * 0.02 = 0.4; row 1 reaches 1 cm nearer:
    # 20 * 0.01 = 0.2; row 2 carries the object 2 cm nearer to its goal at (1, 4, 1): 0.4.
    assert paid(found, 0) == {"navigate/distance": 0.4}
    assert paid(found, 1) == {"pick/approach": 0.2}
    assert paid(found, 2) == {"place/approach": 0.4}
    assert np.allclose(found["reward"], row(0.4, 0.2, 0.4), atol=1e-5)
    assert found["part"]["number"].tolist() == [NAVIGATE, PICK, PLACE]


def test_a_skill_that_is_done_pays_its_success_and_makes_way():
    harness = RulesHarness(HabTidyHouseEnv, 2)
    harness.begin(harness.snapshot(base=bases((0.35, 0), (9, 0))))
    assert [entry[0] for entry in harness.navigation_goals] == [0, 1]
    shot = harness.snapshot(base=bases((0.25, 0), (9, 0)))
    found = harness.step(shot)
    # Within 0.3 m of the origin, without a stop action: 10 + 20 * 0.1.
    assert paid(found, 0) == {"navigate/success": 10.0, "navigate/distance": 2.0}
    assert paid(found, 1) == {}
    assert found["part"]["number"].tolist() == [0, 0]
    found = harness.step(shot)
    assert found["part"]["number"].tolist() == [PICK, 0]
    assert paid(found, 0) == {}, "success is paid once"


def test_no_force_and_no_mistake_ends_a_task():
    harness = RulesHarness(HabTidyHouseEnv, 3)
    first = harness.snapshot(held=held(None, 0, None), force_n=row(1e6, 0.0, 0.0))
    harness.begin(first, PICK, PICK, PICK)
    shot = harness.snapshot(held=held(1, None, None), force_n=row(0.0, 0.0, 500.0))
    found = harness.step(shot)
    assert found["failures"] == {}
    # Row 0 has taken another object, row 1 has dropped its own, row 2 pushes with 500 N; each is
    # paid for in the step in which it happens.
    assert paid(found, 0) == {"pick/wrong_object": -5.0}
    assert paid(found, 1) == {"pick/dropped_object": -5.0, "pick/taken_back": -5.0}
    assert paid(found, 2) == {"pick/force": -0.5}
    found = harness.step(harness.snapshot(held=held(1, None, None)))
    assert not any(paid(found, index) for index in range(3))


def test_navigation_goals_are_starts_goals_and_handles():
    harness = RulesHarness(HabSetTableEnv, 4)
    grips = torch.tensor([[[-2.0, 0.0, 0.5], [-3.0, 1.0, 1.0]]]).repeat(4, 1, 1)
    # To the bowl's start, the bowl's goal, the fridge's handle; row 3 opens the drawer.
    harness.begin(harness.snapshot(handles_m=grips), 2, 4, 8, 1)
    # Episodes begin on the way to the drawer's handle.
    assert harness.navigation_goals == [
        *((n, [-2.0, 0.0, 0.5]) for n in range(4)),
        (0, [1.0, 0.0, 1.0]),
        (1, [1.0, 4.0, 1.0]),
        (2, [-3.0, 1.0, 1.0]),
    ]
