"""Arms that stand still: when their policies' actions are drawn."""

import numpy as np
from hab_tp_srl.stillness import Stillness

ARM_RAD = np.linspace(-1.0, 1.0, 7)


def drawn(motions_rad):
    """Whether actions are drawn while a joint moves by so much per step."""
    stillness, joints_rad = Stillness(), ARM_RAD.copy()
    found = [stillness.draws(joints_rad)]
    for motion_rad in motions_rad:
        joints_rad[3] += motion_rad
        found.append(stillness.draws(joints_rad))
    return found


def test_after_twenty_still_steps_twenty_actions_are_drawn():
    # Step 0 has no step before it. Steps 1 to 20 are still, so that steps 20 to 39 are drawn. Of
    # steps 40 to 59 none moves either: step 59 is the twentieth.
    assert np.flatnonzero(drawn([0.0] * 59)).tolist() == [*range(20, 40), 59]


def test_a_moving_arm_is_not_stuck():
    assert not any(drawn([0.005] * 100))
    assert not any(drawn([*[0.0] * 19, -0.005] * 5))


def test_a_creeping_arm_is_stuck():
    assert np.flatnonzero(drawn([0.003] * 21)).tolist() == [20, 21]


def test_what_moves_while_actions_are_drawn_does_not_end_them():
    assert np.flatnonzero(drawn([*[0.0] * 20, *[0.05] * 40])).tolist() == list(range(20, 40))
