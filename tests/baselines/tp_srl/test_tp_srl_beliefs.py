"""What TP+SRL believes without ground truth, and where it goes before a skill."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hab_navigator.belief import SIDES, GoalBelief, NearSpace, Reach
from hab_navigator.network import HEADINGS
from hab_navigator.views import SIDE
from hab_spa.sensing.cloud import DepthView
from hab_tp_srl.felt import FeltBeliefs
from hab_tp_srl.navigators import LearnedNavigator
from hab_tp_srl.providers import InTurn, LearnedSkill
from hab_tp_srl.sight import Fronts, Look, is_there, seen_through
from hab_tp_srl.view import TaskView
from hab_tp_srl.watch import Watch

from hab_tasks.robots.fetch import FETCH

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
        ("open_fridge", False, 0.7, "open"),  # the arm has not come to rest
        ("close_fridge", False, None, "ajar"),
        ("close_fridge", True, 0.2, "ajar"),
        ("close_fridge", True, None, "closed"),
    ):
        felt.end(stage(skill, 0, articulation=0), ended, pulled_m)
        assert felt.openings == [opening]


def test_a_placed_object_is_believed_where_something_has_appeared():
    """Things stand on a table 1 m below; they are 10 cm high, and pixels 0.9 cm apart there."""
    depth_m, own = np.ones((100, 100)), np.zeros((100, 100), dtype=bool)
    depth_m[70:72, 70:72] = 0.9  # too small
    depth_m[74:80, 70:76] = 0.9  # y -0.2205 to -0.2655, x 0.1845 to 0.2295
    depth_m[60:66, 92:98] = 0.9  # as large, but farther from the goal
    depth_m[68:72, 74:80], own[68:72, 74:80] = 0.9, True  # the robot's own hand
    after, empty = look(depth_m, own=own), look(np.ones((100, 100)))
    goal_m = np.array((0.18, -0.18, -0.9))
    np.testing.assert_allclose(after.appeared_m(empty, goal_m), (0.207, -0.243, -0.9))
    assert empty.appeared_m(after, goal_m) is None
    in_hand = np.ones((100, 100))
    in_hand[60:90, 60:90] = 0.5  # what was held hid the table there, and where the object is now
    np.testing.assert_allclose(after.appeared_m(look(in_hand), goal_m), (0.207, -0.243, -0.9))
    np.testing.assert_allclose(
        look(in_hand).held_m(np.array((0.12, -0.12, -0.5))), (0.125, -0.125, -0.5)
    )
    # Beside it in the image, but 15 cm nearer, is what the hand had hidden as well.
    depth_m[74:80, 76:85], depth_m[:64] = 0.75, 1.0
    np.testing.assert_allclose(
        look(depth_m, own=own).appeared_m(look(in_hand), goal_m), (0.207, -0.243, -0.9)
    )


@pytest.mark.parametrize(
    ("out_m", "hidden", "closed"),
    [
        (0.0, 0, True),
        (0.04, 0, True),  # a drawer may stand 5 cm out
        (0.08, 0, False),
        (-0.3, 0, False),  # there is nothing but what is behind an open door
        (0.0, 60, True),  # the robot hides more than half of the front
        (0.0, 99, None),
    ],
)
def test_a_closed_front_is_seen_where_it_was_when_the_hand_grasped_its_handle(
    out_m, hidden, closed
):
    """A front 1 m away, with a wall above 20 rows of pixels, which are 1 cm apart there."""
    fronts, before, opened = Fronts(), look(np.ones((100, 100))), np.full((100, 100), 1.5)
    hidden_then = np.ones((100, 100), dtype=bool)
    fronts.see(0, look(np.ones((100, 100)), own=hidden_then).surfaces_m)
    fronts.see(0, before.surfaces_m)  # at the second attempt
    assert not len(fronts.of(0))  # it has not been grasped
    fronts.touch(0, np.array((0.0, 0.0, -0.95)))
    fronts.see(0, look(np.full((100, 100), 0.9)).surfaces_m)  # it may stand open since
    opened[:20] = 1.0
    fronts.keep(0, lambda points_m: seen_through(look(opened), points_m))
    assert fronts.of(0)[:, 1].max() < 0.3  # without the wall
    own = np.zeros((100, 100), dtype=bool)
    own[:, :hidden] = True
    now = look(np.full((100, 100), 1.0 - out_m), own=own)
    assert is_there(now, fronts.of(0)) is closed


@pytest.mark.parametrize(
    ("gone", "stays", "took_other"),
    [
        ([(45, 45, 10)], [], False),  # the target, 1 cm aside
        ([(60, 45, 10)], [], True),  # a neighbour, 15 cm aside
        ([(45, 45, 3), (60, 45, 10)], [], False),  # little is seen of the target
        ([(60, 45, 4)], [], False),  # too little to tell
        ([(60, 5, 90)], [], False),  # as large as a door
        ([], [(45, 45, 10)], True),  # the target stands; what was taken was hidden
        ([], [(45, 60, 10)], False),  # a neighbour stands
        ([(45, 45, 8)], [(53, 45, 2)], False),  # little stands there, e.g. what was behind
    ],
)
def test_another_object_is_told_from_the_target_by_where_it_is_gone(gone, stays, took_other):
    """Objects of 10 cm stand 1 m below, where pixels are 0.9 cm apart."""
    depth_m, later_m = np.ones((100, 100)), np.ones((100, 100))
    for row, column, size in gone + stays:
        depth_m[row : row + size, column : column + size] = 0.9
    for row, column, size in stays:
        later_m[row : row + size, column : column + size] = 0.9
    view, before = TaskView(truth=False, feels=True), look(depth_m)
    view.felt = FeltBeliefs(STARTS_M, GOALS_M, [])
    view.felt.held, view._located = 0, (0.0, 0.0, 0.0)
    hand = {"ee_position": np.zeros((1, 3)), "ee_rotation": np.eye(3)[None, :2].reshape(1, 6)}
    view._obs = {"agent": hand}
    view.look = lambda robot: look(later_m)
    assert view.took_other(FETCH, before, np.array((0.0, 0.01, -0.9))) is took_other
    # 15 cm below the hand, pixels are 0.15 cm apart; the middle is at x 0.03 m, and 1.5 cm farther.
    later_m[45:55, 65:75] = 0.15
    # What is seen aside in the hand is another object, unless the target's place is empty.
    empty = any((row, column) == (45, 45) for row, column, _ in gone)
    for held_m, other in (((0.045, 0.0, -0.15), False), ((0.045, 0.08, -0.15), not empty)):
        view._in_hand.in_ee_m = np.array(held_m)
        assert view.took_other(FETCH, before, np.array((0.0, 0.01, -0.9))) is other


@pytest.mark.parametrize(
    ("things", "fallen"),
    [
        ([(50, 50, 5, 1.0)], (0.025, -0.025, 0.1)),  # 5 cm high on the floor, 1.05 m below
        ([(50, 50, 5, 1.0), (60, 20, 30, 1.0)], (0.025, -0.025, 0.1)),  # beside a long step
        ([(50, 50, 5, 1.0), (50, 56, 5, 0.5)], None),  # at the foot of something higher
        ([(5, 45, 10, 0.4), (50, 50, 5, 1.0)], None),  # something stands where it was
        ([], None),
    ],
)
def test_an_object_that_is_not_where_it_was_is_the_small_thing_on_the_floor(things, fallen):
    """Pixels are 1 cm apart on the floor, 1.05 m below the camera; the place is 0.65 m above it."""
    depth_m = np.full((100, 100), 1.05)
    for row, column, size, far_m in things:
        depth_m[row : row + size, column : column + size] = far_m
    seen = look(depth_m)
    # The base frame is on the floor.
    seen = replace(seen, points_m=seen.points_m + np.array((0.0, 0.0, 1.05)))
    seen.base_from_world[2, 3] = 1.05
    here_m = np.array((0.0, 0.16, 0.65))
    found_m = seen.fallen_m(here_m) if seen.misses(here_m) else None
    if fallen is None:
        assert found_m is None
    else:
        np.testing.assert_allclose(found_m, fallen, atol=0.06)


@pytest.mark.parametrize(
    ("column", "other_m", "aside_m"),
    [
        (70, (9.0, 9.0, 0.0), (0.225, 0.0, -0.9)),  # 25 pixels to the right
        (46, (9.0, 9.0, 0.0), None),  # it stands
        (70, (0.2, 0.0, -0.9), None),  # that is another object
    ],
)
def test_an_object_that_was_pushed_aside_is_what_has_appeared_there(column, other_m, aside_m):
    """Objects of 10 cm stand 1 m below, where pixels are 0.9 cm apart."""
    before_m, after_m = np.ones((100, 100)), np.ones((100, 100))
    before_m[45:55, 45:55] = after_m[45:55, column : column + 10] = 0.9
    watch, ee_m, others_m = Watch(), np.array((0.0, 0.3, -0.9)), [np.array(other_m)]
    here_m = np.array((0.0, 0.0, -0.9))
    assert watch.moved_m(look(before_m), 0, here_m, ee_m, others_m) is None
    found_m = watch.moved_m(look(after_m), 0, here_m, ee_m, others_m)
    if aside_m is None:
        assert found_m is None
    else:
        np.testing.assert_allclose(found_m, aside_m, atol=0.02)


@pytest.mark.parametrize(
    ("x_m", "base", "far"), [(1.9, "still", True), (1.7, "still", False), (1.9, "drives", False)]
)
def test_what_no_arm_reaches_is_not_begun(x_m, base, far):
    entries = {("extra", "point_in_base"): np.array((x_m, 0.0, 0.9))}
    view = SimpleNamespace(feels=True, sees=False, truth=False, begin=lambda stage: None)
    view.point, view.entries = (lambda stage: None), (lambda stage, point_m: entries)
    policy = SimpleNamespace(control=SimpleNamespace(base=base))
    skill = LearnedSkill(task=None, policy=policy, view=view, knows_effect=True)  # pyright: ignore
    assert skill._is_far(stage("pick", 0)) is far
    if far:
        with pytest.raises(StopIteration, match="EXECUTION"):
            next(skill.start(None, stage("pick", 0)))  # pyright: ignore


def test_what_has_moved_is_driven_to_anew():
    policy = SimpleNamespace(horizon_steps=1, starts=None, goes_on=lambda turn: True)
    policy.control = SimpleNamespace(base="still")
    points_m = [(1.0, 0.0, 0.8), (1.05, 0.0, 0.8), (1.0, 0.5, 0.8)]
    view = SimpleNamespace(point=lambda stage: np.array(points_m[0]))
    navigator = LearnedNavigator(policy, {"pick": policy}, view)  # pyright: ignore
    request = SimpleNamespace(stage=SimpleNamespace(action="pick(a)", skill="pick"))
    turns = []
    while points_m:
        navigator.go(SimpleNamespace(next_seed=lambda: 0), request)
        turns.append(navigator._last)
        del points_m[0]
    assert turns[0] is turns[1]
    assert turns[2].before is turns[1]


def test_further_attempts_of_a_stage_are_by_the_next_in_turn():
    parts = [SimpleNamespace(name=name, start=lambda *_: iter(())) for name in ("spa", "depth")]
    skill, stages = InTurn(parts=parts), [SimpleNamespace(action=action) for action in ("a", "b")]
    by = []
    for number in (0, 0, 1, 0):
        skill.start(None, stages[number])
        by.append(skill.name)
    assert by == ["spa", "depth", "spa", "spa"]


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


def look(depth_m, own=None):
    """A look down from the origin, with the base's x to the right."""
    view = DepthView(
        depth_m=depth_m,
        focal_px=np.full(2, 100.0),
        centre_px=np.array(depth_m.shape[::-1]) / 2,
        world_from_camera=np.eye(4),
    )
    down = np.diag((1.0, -1.0, -1.0, 1.0))
    return Look(
        points_m=view.points_m @ down[:3, :3],
        own=np.zeros(depth_m.shape, dtype=bool) if own is None else own,
        view=view,
        base_from_world=down,
    )
