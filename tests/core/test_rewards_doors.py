"""Success, failures and reward of fridge and drawer on hand-made rows (App. H.2)."""

import math
from dataclasses import replace

import pytest
import torch
from builders import evaluate_rules, measures, row, snapshot

from hab_tasks.engine.goals import Goals
from hab_tasks.skills.close_drawer import CLOSE_DRAWER
from hab_tasks.skills.close_fridge import CLOSE_FRIDGE
from hab_tasks.skills.open_drawer import OPEN_DRAWER
from hab_tasks.skills.open_fridge import OPEN_FRIDGE

FRAME = torch.tensor([[[1.0, 2.0, math.pi / 2]]])
"""(1, 1, 3): the fridge at (1, 2) looks along the world's +y, its left is the world's -x."""


def before_the_fridge(*places):
    """Snapshot and goals with the bases at these places of the fridge's frame, ahead and left."""
    base = torch.tensor([[1.0 - left, 2.0 + ahead, 0.3] for ahead, left in places])
    goals = Goals.empty(len(places), 1, 1, "cpu")
    frame = FRAME.expand(len(places), 1, 3).contiguous()
    return snapshot(len(places), articulations=1, base=base), replace(
        goals, articulation_frame=frame
    )


AT_THE_FRIDGE = before_the_fridge(*[(1.4, 0.0)] * 4)


def reaching(**values):
    """Row 0 reaches, row 1 grabs, row 2 succeeds at rest, row 3 moves the joint the wrong way."""
    return measures(
        4,
        ee_to_handle_decrease_m=row(0.01, 0.004, -0.01, 0.0),
        grabbed_now=row(False, True, False, False),
        ee_to_rest_m=row(0.6, 0.6, 0.149, 0.1),
        force_n=row(1e5, 0.0, 0.0, 0.0),  # no force is too much
        force_total_n=row(1e6, 0.0, 0.0, 0.0),
        **values,
    )


@pytest.mark.parametrize(
    ("skill", "values", "paid"),
    [
        # Row 0: 0.01. Row 1: 5 + 0.004. Row 2 opens beyond pi / 2 = 1.5708: 10 - 0.01 + 0.05.
        # Row 3 lets the door fall to.
        (
            OPEN_FRIDGE,
            {"joint_increase": row(0.0, 0.0, 0.05, -0.02), "joint": row(0.0, 0.0, 1.571, 1.5)},
            row(0.01, 5.004, 10.04, -0.02),
        ),
        # Row 1 grabs the handle, which closing does not pay.
        (
            CLOSE_FRIDGE,
            {"joint_increase": row(0.0, 0.0, -0.05, 0.02), "joint": row(1.0, 1.0, 0.149, 0.2)},
            row(0.01, 0.004, 10.04, -0.02),
        ),
        # Row 2: 10 - 0.01 + 0.03; 0.27 m is open, by its share of the travel.
        (
            OPEN_DRAWER,
            {
                "joint_increase": row(0.0, 0.0, 0.03, -0.02),
                "joint": row(0.0, 0.0, 0.27, 0.26),
                "joint_share": row(0.0, 0.0, 0.9, 0.87),
            },
            row(0.01, 5.004, 10.02, -0.02),
        ),
        (
            CLOSE_DRAWER,
            {"joint_increase": row(0.0, 0.0, -0.03, 0.02), "joint": row(0.3, 0.3, 0.049, 0.06)},
            row(0.01, 0.004, 10.02, -0.02),
        ),
    ],
    ids=["open fridge", "close fridge", "open drawer", "close drawer"],
)
def test_reaching_moving_and_success(skill, values, paid):
    success, failures, terms, reward, _ = evaluate_rules(skill, reaching(**values), *AT_THE_FRIDGE)
    assert torch.allclose(reward, paid)
    assert success.tolist() == [False, False, True, False]
    assert list(failures) == (["left_region"] if skill in (OPEN_FRIDGE, CLOSE_FRIDGE) else [])
    assert not any(failure.any() for failure in failures.values())
    way = values["joint_increase"] * (1 if skill in (OPEN_FRIDGE, OPEN_DRAWER) else -1)
    assert torch.allclose(terms["joint"], way)
    assert torch.allclose(terms["handle"], row(0.01, 0.004, -0.01, 0.0))
    if "grabbed" in terms:
        assert torch.allclose(terms["grabbed"], row(0.0, 5.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("skill", "joint", "paid"), [(OPEN_FRIDGE, 2.0, -10), (CLOSE_FRIDGE, 0.1, 0)]
)
def test_leaving_the_region_ends_the_episode_and_costs_10_while_opening(skill, joint, paid):
    s, g = before_the_fridge((1.4, 0.0), (0.9, 0.0))
    m = measures(2, joint=row(joint, joint), ee_to_rest_m=row(0.1, 0.1))
    success, failures, _, reward, _ = evaluate_rules(skill, m, s, g)
    assert success.tolist() == [True, False]
    assert failures["left_region"].tolist() == [False, True]
    assert torch.allclose(reward, row(10.0, float(paid)))


@pytest.mark.parametrize("skill", [OPEN_FRIDGE, CLOSE_FRIDGE], ids=["open", "close"])
def test_the_region_is_a_rectangle_of_90_by_120_cm(skill):
    # 0.933 + 0.9 = 1.833 m ahead; 0.6 m to both sides.
    inside = [(0.94, 0.0), (1.83, 0.0), (1.4, 0.59), (1.4, -0.59)]
    outside = [(0.92, 0.0), (1.84, 0.0), (1.4, 0.61), (1.4, -0.61), (-1.4, 0.0)]
    s, g = before_the_fridge(*inside, *outside)
    left = evaluate_rules(skill, measures(9), s, g).failures["left_region"]
    assert left.tolist() == [False] * 4 + [True] * 5


def test_open_and_closed_are_beyond_their_thresholds_and_at_rest():
    angles = row(1.57, 1.5709, 2.3, 2.3)
    for skill, values, done in (
        (OPEN_FRIDGE, {"joint": angles, "joint_share": angles / 2.3}, [False, True, True, False]),
        (CLOSE_FRIDGE, {"joint": row(0.151, 0.149, 0.0, 0.0)}, [False, True, True, False]),
        (OPEN_DRAWER, {"joint_share": row(0.8999, 0.9001, 1.0, 1.0)}, [False, True, True, False]),
        (CLOSE_DRAWER, {"joint": row(0.051, 0.049, 0.0, 0.0)}, [False, True, True, False]),
    ):
        m = measures(4, ee_to_rest_m=row(0.0, 0.0, 0.1499, 0.15), **values)
        assert evaluate_rules(skill, m, *AT_THE_FRIDGE).success.tolist() == done, skill.name


def test_terms_stand_in_the_order_of_the_equation_no_step_pays_more_and_the_gripper_is_free():
    one = before_the_fridge((1.4, 0.0))
    gripper = row(-1.0, -0.2, 0.0, 0.7)
    held = measures(4, holding_handle=row(True, True, True, True))
    for skill, joint, way, terms in (
        (OPEN_FRIDGE, 2.0, 0.5, ["success", "grabbed", "handle", "joint", "left_region"]),
        (OPEN_DRAWER, 2.0, 0.5, ["success", "grabbed", "handle", "joint"]),
        (CLOSE_FRIDGE, 0.0, -0.5, ["success", "handle", "joint"]),
        (CLOSE_DRAWER, 0.0, -0.5, ["success", "handle", "joint"]),
    ):
        assert list(evaluate_rules(skill, measures(2)).terms) == terms
        m = measures(
            1,
            joint=row(joint),
            joint_share=row(joint / 2),
            grabbed_now=row(True),
            ee_to_handle_decrease_m=row(0.25),
            joint_increase=row(way),
        )
        # 10 + 0.25 + 0.5 = 10.75, and 5 for grabbing
        most = 15.75 if "grabbed" in terms else 10.75
        assert evaluate_rules(skill, m, *one).reward.item() == pytest.approx(most)
        assert skill.reward_bound == most
        assert torch.equal(skill.mask_gripper(gripper, held), gripper)
