"""The navigator: its map, floor, views and lessons against values worked out by hand."""

import math

import numpy as np
import pytest
import torch
from hab_navigator.lessons import Lessons, fit, from_middle, goal_bins, misfit, turned_goals
from hab_navigator.navigator import BACK_CELL, REPEAT, Navigator
from hab_navigator.network import HEADINGS, GoalNetwork
from hab_navigator.robot_map import CELLS, RAYS_PX, SEEN, VISITED, RobotMap, _rays
from hab_navigator.seen_floor import SeenFloor
from hab_navigator.views import SIDE, TOPS_SCALE, WHOLE, View, inputs

from hab_tasks.robots.control_modes import BASE_CELLS, STOP_CELL
from hab_tasks.robots.fetch import FETCH

NOTHING = np.zeros((128, 128, 1), dtype=np.float32)
MIDDLE = CELLS // 2
TURN_RAD = REPEAT * 3.14 / 30
"""Turn of four steps at full speed."""


def point(x, y):
    return np.array([x, y, 0.8], dtype=np.float32)


def from_base(x, y, yaw):
    """A point of the first frame in that of a base at the origin which has turned."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    return point(cosine * x + sine * y, cosine * y - sine * x)


def wall_ahead(distance_m):
    """The depth image of a wall; the camera is at x = 0.17 and looks down by 0.2 in 0.58."""
    slopes = 2 * (np.arange(128) + 0.5) / 128 - 1
    down_rad = np.arctan2(0.2, 0.58)
    # A ray goes 1 forwards and s down in the camera; tilted, cos - s sin forwards in the base.
    forward = np.cos(down_rad) - slopes * np.sin(down_rad)
    depth_m = (distance_m - 0.17) / forward
    return (np.repeat(depth_m[:, None], 128, axis=1) / 10.0)[..., None].astype(np.float32)


def table_ahead(distance_m, behind_m):
    """The image of a table's edge 0.6 to 0.8 m high, and of the wall behind it."""
    edge, slopes = wall_ahead(distance_m), 2 * (np.arange(128) + 0.5) / 128 - 1
    down_rad = np.arctan2(0.2, 0.58)
    drop = np.sin(down_rad) + slopes * np.cos(down_rad)  # of a ray, for each metre of depth
    height_m = 1.2 - 10.0 * edge[:, :, 0] * drop[:, None]
    hits = (height_m > 0.6) & (height_m < 0.8)
    return np.where(hits[..., None], edge, wall_ahead(behind_m))


def corner(yaw_rad, y_m):
    """The depth image of walls 2 m ahead and 1.5 m to the left of a base that was then moved."""
    rotation = np.array([[np.cos(yaw_rad), -np.sin(yaw_rad)], [np.sin(yaw_rad), np.cos(yaw_rad)]])
    camera = FETCH.cameras["head"]
    rays, start = _rays(camera, RAYS_PX)[..., :2] @ rotation.T, rotation @ camera.position_m[:2]
    start += [0.0, y_m]
    away_m = (np.array([2.0, 1.5]) - start) / np.maximum(rays, 1e-3)
    depth_m = np.minimum(away_m.min(axis=2), 10.0)
    return np.kron(depth_m, np.ones((2, 2)))[..., None].astype(np.float32) / 10.0


def test_the_pose_follows_from_the_turns_and_the_point():
    map_ = RobotMap(FETCH, REPEAT)
    map_.look(NOTHING, point(2.0, 1.0))
    assert map_.pose.tolist() == [0.0, 0.0, 0.0]
    map_.take(BASE_CELLS.index((0.0, 1.0)))
    map_.look(NOTHING, from_base(2.0, 1.0, TURN_RAD))
    assert map_.pose == pytest.approx([0.0, 0.0, TURN_RAD], abs=1e-6)
    map_.take(BASE_CELLS.index((1.0, 0.0)))
    ahead = 0.13 * np.array([np.cos(TURN_RAD), np.sin(TURN_RAD)])
    map_.look(NOTHING, from_base(2.0 - ahead[0], 1.0 - ahead[1], TURN_RAD))
    assert map_.pose == pytest.approx([*ahead, TURN_RAD], abs=1e-6)
    map_.take(BASE_CELLS.index((1.0, 1.0)))  # something blocks it, so it does not turn either
    map_.look(NOTHING, from_base(2.0 - ahead[0], 1.0 - ahead[1], TURN_RAD))
    assert map_.pose == pytest.approx([*ahead, TURN_RAD], abs=1e-6)


def test_where_the_base_pose_is_known_the_map_follows_it_to_any_point():
    map_ = RobotMap(FETCH, 4)
    map_.look(NOTHING, np.array((2.0, 0.0, 0.5)), np.array((1.0, 2.0, math.pi / 2)))
    assert map_.pose == pytest.approx((0.0, 0.0, 0.0))
    assert map_.point_m == pytest.approx((2.0, 0.0))
    # One metre ahead, and a quarter turn to the left; the next point is a metre ahead of there.
    map_.forget_point()
    map_.look(NOTHING, np.array((1.0, 0.0, 0.5)), np.array((1.0, 3.0, math.pi)))
    assert map_.pose == pytest.approx((1.0, 0.0, math.pi / 2))
    assert map_.point_m == pytest.approx((1.0, 1.0))


@pytest.mark.parametrize("turned_rad", [-0.05, TURN_RAD + 0.05])
def test_a_base_that_touches_something_finds_its_yaw_by_what_it_sees(turned_rad):
    """It wants to turn in place; something turns it by another angle and moves it aside by 5 cm."""
    map_ = RobotMap(FETCH, REPEAT)
    map_.look(corner(0.0, 0.0), point(1.0, 2.0))
    map_.take(BASE_CELLS.index((0.0, 1.0)))
    map_.look(corner(turned_rad, 0.05), from_base(1.0, 1.95, turned_rad))
    # Yaws 0.01 rad apart are tried; cells of 0.1 m hide a difference of about as much again.
    assert map_.pose[2] == pytest.approx(turned_rad, abs=0.025)
    assert map_.pose[:2] == pytest.approx([0.0, 0.05], abs=0.06)


def test_a_wall_is_drawn_where_it_is():
    map_ = RobotMap(FETCH, REPEAT)
    map_.look(wall_ahead(1.25), point(1.25, 0.5))
    # A cell is 0.1 m, and the first pose is at the corner of four: 1.25 m ahead is the thirteenth.
    assert set(np.flatnonzero(map_.tops.any(axis=1))) == {MIDDLE + 12}
    # At the floor, 1.2 m down and 1.08 m ahead of the camera, depth is 1.08 m / 0.764 = 1.41 m, and
    # the image is as wide to both sides: 14 cells.
    assert 26 <= np.count_nonzero(map_.tops[MIDDLE + 12]) <= 28
    assert (map_.seen[map_.tops > 0] == SEEN).all()
    assert map_.seen[MIDDLE, MIDDLE] == VISITED


def test_where_the_base_pose_is_known_what_is_seen_through_is_forgotten():
    for first, then, left in (
        (wall_ahead(1.25), wall_ahead(2.05), [20]),  # a door that was moved
        (table_ahead(1.25, 2.05), table_ahead(1.25, 2.05), [12, 20]),
        (wall_ahead(1.25), table_ahead(1.25, 2.05), [12, 20]),
    ):
        map_ = RobotMap(FETCH, REPEAT)
        for image in (first, then):
            map_.look(image, point(1.25, 0.5), np.zeros(3))
        middle = map_.tops[:, MIDDLE - 4 : MIDDLE + 4]
        assert (np.flatnonzero(middle.any(axis=1)) - MIDDLE).tolist() == left


def test_in_a_task_a_base_that_comes_no_farther_drives_back():
    navigator = Navigator(FETCH, Believing([[-1.05, 0.05, 0.0]], [1.0]), stops="once")
    cells = [navigator.action(NOTHING, point(3.0, 0.0), False, np.zeros(3)) for _ in range(21)]
    # At the fourteenth pose it is known to be stuck: six actions back, and it tries again.
    assert [cell == BACK_CELL for cell in cells] == [False] * 13 + [True] * 6 + [False] * 2


def test_a_base_passes_a_gap_that_is_as_wide():
    """In a wall at x = 1 m, a gap of 0.9 m opens at y = 0."""
    map_ = RobotMap(FETCH, REPEAT)
    map_.look(NOTHING, point(2.0, 0.0))
    map_.seen[MIDDLE - 20 : MIDDLE + 30, MIDDLE - 20 : MIDDLE + 20] = SEEN
    map_.tops[MIDDLE + 10] = 200
    map_.tops[MIDDLE + 10, MIDDLE - 4 : MIDDLE + 5] = 0
    through, closed = SeenFloor(map_, 0.3), SeenFloor(map_, 0.6)
    ends = np.array([[0.0, 0.0], [2.0, 0.0]])
    assert through.is_free(ends).all()
    assert through.clear(*ends)
    assert closed.is_free(ends).tolist() == [True, False]
    assert not through.clear(np.array([0.0, 1.5]), np.array([2.0, 1.5]))
    ways_m = through.geodesic_field(ends[1])
    assert 2.0 <= ways_m[tuple(through.cells_of(ends[0]))] < 6.0
    assert not np.isfinite(ways_m[~through.room]).any()


def marked(goals):
    """Views with a mark at each goal (N, 3), around a point in the middle."""
    maps = torch.zeros(len(goals), 2, WHOLE, WHOLE, dtype=torch.uint8)
    cells = (goals[:, :2] / 0.1).floor().long() + WHOLE // 2
    for number, (x, y) in enumerate(cells.tolist()):
        maps[number, 0, x - 1 : x + 2, y - 1 : y + 2] = int(TOPS_SCALE)
        maps[number, 0, x, y] = 2 * int(TOPS_SCALE)
    return View(maps, torch.zeros(len(goals), 2))


def test_goals_turn_with_their_views():
    generator = torch.Generator().manual_seed(0)
    goals = torch.zeros(100, 3)
    goals[:, :2] = 4.4 * (torch.rand(100, 2, generator=generator) - 0.5)
    angles = 6.28 * torch.rand(100, generator=generator)
    flips = torch.rand(100, generator=generator) < 0.5
    # The nearest cell of a turned map may be one aside, and its mark is three wide.
    for turns, most in (((None, None), 0), ((angles, flips), 2)):
        turned = turned_goals(goals, *turns) if most else goals
        highest = inputs(marked(goals), *turns)[:, 0].flatten(1).argmax(1)
        cells = goal_bins(turned) % SIDE**2
        rows, columns = highest // SIDE - cells // SIDE, highest % SIDE - cells % SIDE
        gaps = torch.stack((rows, columns)).abs()
        assert gaps.max() <= most
        assert gaps.float().mean() < 0.5


def test_a_lesson_tells_where_the_goal_is_from_the_point():
    map_ = RobotMap(FETCH, REPEAT)
    map_.look(NOTHING, point(2.0, 1.0))
    goal = from_middle(map_, np.array([1.0, 1.0, 0.3]))
    assert goal.tolist() == pytest.approx((-1.0, 0.0, 0.3))
    # Bins of 0.4 rad around 0: 0.3 is in the first to the left, the cell 10 before the middle.
    heading, cell = divmod(int(goal_bins(goal[None])), SIDE**2)
    assert heading == HEADINGS // 2 + 1
    assert divmod(cell, SIDE) in [(SIDE // 2 - 10, SIDE // 2), (SIDE // 2 - 11, SIDE // 2)]


def test_a_network_learns_where_goals_are(monkeypatch):
    monkeypatch.setattr("hab_navigator.lessons.BATCH", 12)
    goals = torch.zeros(24, 3)
    goals[:, :2] = 3 * (torch.rand(24, 2, generator=torch.Generator().manual_seed(1)) - 0.5)
    lessons = Lessons(marked(goals), goals)
    torch.manual_seed(0)
    network = GoalNetwork()
    before = misfit(network.eval(), lessons)
    fit(network, lessons, 8, seed=0)
    # Of 2,100 cells within 2.6 m and 7 headings: ln 14,800 = 9.6.
    assert before > 8.0
    assert misfit(network, lessons) < before - 1.0


class Believing(torch.nn.Module):
    """A network that believes in given goals (x, y, heading from the direction to the point)."""

    def __init__(self, goals, shares):
        super().__init__()
        logits = torch.full((HEADINGS * SIDE**2,), -20.0)
        logits[goal_bins(torch.tensor(goals))] = torch.tensor(shares).log()
        self.logits = logits.reshape(1, HEADINGS, SIDE, SIDE)

    def forward(self, seen):
        return self.logits.expand(len(seen), -1, -1, -1)


def drive(navigator, to, actions):
    """Drives on an empty floor; returns all poses, and those of the stops."""
    base, passed, stops = np.zeros(3), [], []
    for _ in range(actions):
        passed.append(base.copy())
        cell = navigator.action(NOTHING, from_base(*(np.array(to) - base[:2]), base[2]), False)
        forward, turn = BASE_CELLS[cell]
        if cell == STOP_CELL:
            stops.append(base.copy())
        for _ in range(REPEAT):
            base[2] += turn * 3.14 / 30
            base[:2] += forward / 30 * np.array([np.cos(base[2]), np.sin(base[2])])
    return passed, stops


def is_at(base, place, away_m=0.3):
    return np.linalg.norm(base[:2] - np.array(place)) < away_m


@pytest.mark.parametrize("mode", ["often", "once", "never"])
def test_it_stops_at_the_likeliest_place_first_and_then_at_the_next(mode):
    """Without a stop, it passes one after the other."""
    goals = [[-1.05, 0.05, 0.0], [0.05, -1.05, 0.0]]
    navigator = Navigator(FETCH, Believing(goals, [0.8, 0.2]), stops=mode)
    passed, stops = drive(navigator, (3.0, 0.0), 100)
    if mode == "never":
        for place in ((2.0, 0.0), (3.0, -1.0)):
            assert any(is_at(base, place, 0.25) for base in passed)
        return
    assert is_at(stops[0], (2.0, 0.0))
    assert abs(stops[0][2]) < 0.5
    # The second one is 1 m to the right of the point, which it faces.
    facing = [one for one in stops[1:] if abs(math.remainder(one[2] - np.pi / 2, 2 * np.pi)) < 0.5]
    assert any(is_at(stop, (3.0, -1.0), 0.25) for stop in facing)
