"""What TP+SRL believes without ground truth, and where it goes before a skill."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hab_navigator.belief import SIDES, GoalBelief, NearSpace, Reach
from hab_navigator.network import HEADINGS
from hab_navigator.views import SIDE
from hab_tp_srl.felt import FeltBeliefs

STARTS_M = np.array(((1.0, 0.0, 0.8), (2.0, 0.0, 0.8)))
GOALS_M = np.array(((0.0, 1.0, 0.5), (0.0, 2.0, 0.5)))


@pytest.mark.parametrize(
    ("hand_m", "place_m"),
    [
        ((0.1, 1.0, 0.75), (0.1, 1.0, 0.5)),  # 0.1 m beside its goal, 0.2 m above: it falls there
        ((0.2, 1.0, 0.75), (0.2, 1.0, 0.7)),  # 0.2 m beside it: it is not placed
        ((0.1, 1.0, 0.90), (0.1, 1.0, 0.85)),  # 0.35 m above it
    ],
)
def test_an_object_is_believed_where_the_hand_let_it_go(hand_m, place_m):
    felt = FeltBeliefs(STARTS_M, GOALS_M, ["closed"])
    felt.begin(stage("pick", 0))
    felt.feel(True, np.array((1.0, 0.0, 0.85)))  # 5 cm above its middle
    assert felt.held == 0
    felt.feel(False, np.array(hand_m))
    assert felt.held is None
    assert felt.moved.tolist() == [True, False]
    np.testing.assert_allclose(felt.places_m, (place_m, STARTS_M[1]))


def test_a_door_is_open_once_the_hand_has_pulled_it_far_enough():
    felt = FeltBeliefs(STARTS_M, GOALS_M, ["closed"])
    for skill, ended, pulled_m, opening in (
        ("open_fridge", True, 0.5, "ajar"),
        ("open_fridge", True, 0.7, "open"),
        ("close_fridge", False, None, "ajar"),
        ("close_fridge", True, None, "closed"),
    ):
        felt.end(stage(skill, 0, articulation=0), ended, pulled_m)
        assert felt.openings == [opening]


def test_the_base_goes_where_the_next_skill_can_start():
    map_ = SimpleNamespace(point_m=np.zeros(2))
    reach = Reach(distance_m=(0.5, 1.0), bearing_rad=(-0.3, 0.3), level=True)
    belief = GoalBelief(map_, reach)  # pyright: ignore[reportArgumentType]
    belief.learn(np.full((HEADINGS, SIDE, SIDE), 1.0))
    belief.see(np.where(np.arange(SIDES) == 0, np.inf, 0.0))  # from +x only
    belief.update(np.ones((SIDE, SIDE), dtype=bool))
    heading, *cell = np.unravel_index(belief.found.argmax(), belief.found.shape)
    x, y = belief.places_m[tuple(cell)]
    assert heading == HEADINGS // 2  # it faces the point
    assert x > 0.0
    assert abs(y) < math.tan(math.pi / SIDES) * x
    assert 0.5 <= math.hypot(x, y) <= 1.0
    distances_m = np.linalg.norm(belief.places_m, axis=-1)
    assert not belief.found[:, (distances_m < 0.5) | (distances_m > 1.0)].any()


def test_the_hand_has_room_between_the_walls_of_a_fridge():
    space = NearSpace(np.array((0.0, 0.0, 1.3)))
    x, z = np.meshgrid(np.arange(-0.3, 0.3, 0.02), np.arange(0.9, 1.7, 0.02))
    for y in (-0.3, 0.3):
        space.add(np.column_stack((x.ravel(), np.full(x.size, y), z.ravel())))
    space.add(np.column_stack((np.full(x.size, -0.3), x.ravel(), z.ravel())))
    room_m = space.clearances_m()
    assert room_m.argmax() == 0  # the opening is at +x
    assert room_m[0] == pytest.approx(0.3, abs=0.06)
    assert room_m[SIDES // 4] < 0.05
    assert room_m[SIDES // 2] < 0.05


def stage(skill, number, articulation=None):
    return SimpleNamespace(skill=skill, object=number, articulation=articulation)
