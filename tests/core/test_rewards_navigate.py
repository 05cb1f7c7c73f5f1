"""Success, reward and score of Navigate on hand-made rows (App. H.2)."""

import numpy as np
import pytest
import torch
from builders import evaluate_rules, measures, row, snapshot

from hab_tasks.engine.goals import Goals
from hab_tasks.skills.navigate import NAVIGATE


def test_driving_turning_and_success():
    m = measures(
        6,
        base_to_goal_m=row(3.0, 0.89, 0.29, 0.91, 0.89, 0.91),
        base_to_goal_decrease_m=row(0.02, -0.01, 0.0, 0.0, 0.02, -0.02),
        heading_error_rad=row(2.0, 1.0, 0.49, 0.0, 1.0, 1.1),
        heading_error_decrease_rad=row(0.05, 0.04, -0.03, 0.05, 0.1, -0.1),
        stopped=row(False, False, True, True, False, False),
        force_total_n=row(1e6, 0.0, 0.0, 0.0, 0.0, 0.0),
    )
    success, failures, _, reward, _ = evaluate_rules(NAVIGATE, m)
    # Row 0 drives: 20 * 0.02 = 0.4; turning is not paid from afar, and no force is too much.
    # Row 1: 20 * -0.01 + 1 * 0.04 = -0.16. Row 2: 10 - 0.03 = 9.97. Row 3: 0.91 m is not near.
    # Row 4 comes near, facing 1 rad off: 20 * 0.02 + pi - 1 = 2.5416; row 5 leaves again: -2.5416.
    assert np.allclose(reward, row(0.4, -0.16, 9.97, 0.0, 2.541593, -2.541593))
    assert success.tolist() == [number == 2 for number in range(6)]
    assert failures == {}
    # At most 0.25 m and half a turn in a step: 10 + 20 * 0.25 + pi.
    assert NAVIGATE.reward_bound == pytest.approx(18.141593)


def test_success_needs_place_heading_and_stop():
    m = measures(
        5,
        base_to_goal_m=row(0.299, 0.3, 0.299, 0.299, 0.0),
        heading_error_rad=row(0.499, 0.499, 0.5, 0.499, 0.0),
        stopped=row(True, True, True, False, True),
    )
    assert evaluate_rules(NAVIGATE, m).success.tolist() == [True, False, False, False, True]
    # A task has no stop action: it goes on as soon as the base has arrived.
    done = NAVIGATE.done(snapshot(5), m, Goals.empty(5, 1, 0))
    assert done.tolist() == [True, False, False, True, True]
    # Without a learned stop, arriving is enough.
    fixed = evaluate_rules(NAVIGATE.changed({"learned_stop": 0}), m)
    assert fixed.success.tolist() == [True, False, False, True, True]


def test_spl_by_hand():
    m = measures(
        4,
        base_to_goal_start_m=row(3.0, 3.0, 3.0, 3.0),
        path_m=row(4.0, 2.9, 3.0, 4.0),
        stopped=row(True, True, True, False),
    )
    # 3 / 4 = 0.75; a way shorter than the distance (the goal has a radius) is 1; no success is 0
    assert np.allclose(evaluate_rules(NAVIGATE, m).scores["spl"], row(0.75, 1.0, 1.0, 0.0))


def test_what_is_held_stays_held_and_nothing_is_grasped():
    m = measures(
        4,
        holding_target=row(True, False, False, False),
        holding_other=row(False, True, False, False),
        holding_handle=row(False, False, True, False),
    )
    for gripper in (-1.0, 0.7):
        masked = NAVIGATE.mask_gripper(torch.full((4,), gripper), m)
        assert (masked >= 0).tolist() == [True, True, True, False]
