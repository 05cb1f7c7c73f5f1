"""Free floor, geodesic distances, paths and reaching poses, compared with manual calculations."""

from itertools import pairwise

import numpy as np
import pytest
from geodesics import geodesic_distance

from hab_tasks.errors import GenerationError
from hab_tasks.privileged import CollisionBody, CollisionShape
from hab_tasks.world.navigation import NavigationMap, path_between, poses_reaching
from hab_tasks.world.scenes.floor import CELL_M
from hab_tasks.world.scenes.habitat.dataset import SceneDataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.layout_geometry import Layout

FLOOR = ((0, 0, -0.1), (6, 4, 0))
WALL = ((3, 0, 0), (3.1, 2.5, 2.7))
TABLE = ((0, 1.5, 0), (1, 2.5, 0.8))


def box(low, high):
    center = np.eye(4)
    center[:3, 3] = np.add(low, high) / 2
    return CollisionShape(
        kind="box",
        body_from_shape=center,
        half_size_m=np.subtract(high, low) / 2,
        vertices_m=np.zeros((0, 3)),
        faces=np.zeros((0, 3), dtype=np.int64),
    )


def room(*furniture):
    """A room of 6 x 4 m with an inner wall, and furniture."""
    shapes = {"stage": tuple(box(*corners) for corners in (FLOOR, WALL))}
    shapes |= {f"piece_{i}": (box(*corners),) for i, corners in enumerate(furniture)}
    bodies = [
        CollisionBody(name=name, group="static" if "piece" in name else name, shapes=boxes)
        for name, boxes in shapes.items()
    ]
    return NavigationMap.of_bodies(bodies, dict.fromkeys(shapes, np.eye(4)))


def test_a_rug_and_a_lamp_overhead_are_no_obstacles():
    rug, lamp = ((1, 1, 0), (3, 3, 0.03)), ((2, 2, 1.5), (2.2, 2.2, 2.0))
    assert (room(rug, lamp).free == room().free).all()
    with pytest.raises(GenerationError, match="no free floor"):
        room(((0, 0, 0), (6, 4, 2)))


def test_distances_are_those_of_the_taut_string():
    map_, goal = room(), np.array([1.03, 1.48])
    field = map_.geodesic_field(goal)
    points = np.random.default_rng(1).uniform((0.4, 0.4), (2.5, 3.5), (200, 2))
    straight = np.linalg.norm(points - goal, axis=1)
    assert np.abs(geodesic_distance(map_, points, field) - straight).max() < CELL_M / 2
    assert (np.isfinite(field) == map_.free).all()
    # From (1.5, 1) the wall's end at (3, 2.5) is 1.5 * sqrt(2) m away; the tangent to the circle
    # of 0.3 m around it is sqrt(4.5 - 0.09) = 2.1 m long and rises at 45 + 8.13 = 53.13 degrees
    # (3-4-5), so the arc is 0.3 * 0.9273 = 0.2782 m. Then 0.1 m along the wall's end, and the
    # same again: 2 * (2.1 + 0.2782) + 0.1 = 4.856 m.
    field = map_.geodesic_field(np.array([4.6, 1.0]))
    found = geodesic_distance(map_, np.array([1.5, 1.0]), field)
    assert found == pytest.approx(4.856, rel=0.03)


def test_goals_may_be_several_or_cells_or_in_a_wall():
    map_ = room()
    left, right = np.array([0.6, 1.0]), np.array([5.4, 1.0])
    both = map_.geodesic_field(np.stack((left, right)))
    each = np.minimum(map_.geodesic_field(left), map_.geodesic_field(right))
    assert np.abs(both[map_.free] - each[map_.free]).max() < CELL_M / 2
    goals = np.zeros_like(map_.free)
    assert np.isinf(map_.geodesic_field(goals)).all()
    goals[map_.free] = map_.positions(np.argwhere(map_.free))[:, 0] > 5.0
    # From x = 4 it is 1 m to the right, less than a cell more to the first goal cell's middle.
    found = geodesic_distance(map_, np.array([4.0, 3.0]), map_.geodesic_field(goals))
    assert found == pytest.approx(1.0, abs=CELL_M)
    inside_wall = np.array([3.02, 1.0])
    nearest = map_.nearest_free(inside_wall)
    # Left of the wall the base's middle is at x <= 2.7.
    assert nearest == pytest.approx([2.7, 1.0], abs=CELL_M)
    found = geodesic_distance(map_, nearest, map_.geodesic_field(inside_wall))
    assert found == pytest.approx(0.0, abs=1e-6)
    points = np.random.default_rng(2).uniform(-1.0, 7.0, (3, 5, 2))
    assert map_.is_free(map_.nearest_free(points)).all()


def test_ways_are_free_and_as_short_as_their_distance():
    map_ = room(TABLE, ((4.5, 2.0, 0), (5.0, 4.0, 0.8)))
    rng = np.random.default_rng(3)
    cells = np.argwhere(map_.free)
    for _ in range(50):
        start, goal = map_.positions(cells[rng.integers(len(cells), size=2)])
        path = path_between(map_, start, goal)
        assert np.allclose(path[[0, -1]], (start, goal))
        assert all(map_.clear(a, b) for a, b in pairwise(path))
        length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
        distance = float(geodesic_distance(map_, start, map_.geodesic_field(goal)))
        assert 0.97 * distance - CELL_M <= length <= 1.03 * distance + CELL_M


def test_poses_reach_the_target_face_it_and_start_near():
    target = np.array([0.8, 2.0, 0.8])
    poses = poses_reaching(room(TABLE), target)
    gap = target[:2] - poses[:, :2]
    distance = np.linalg.norm(gap, axis=1)
    assert len(poses) > 20
    assert ((distance >= 0.45) & (distance <= 1.1)).all()
    assert (np.diff(distance) >= -1e-9).all()
    facing = np.column_stack((np.cos(poses[:, 2]), np.sin(poses[:, 2])))
    assert np.allclose(facing, gap / distance[:, None])
    # The nearest: in front of the table's edge at x = 1, with 0.3 m for the base.
    assert poses[0, :2] == pytest.approx([1.3, 2.0], abs=1.5 * CELL_M)


def test_poses_are_not_behind_walls_or_other_furniture():
    # The shelf stands at the wall; behind it is free floor 0.55 m from the target.
    shelf, target = ((2.7, 0.5, 0), (3.0, 1.5, 0.8)), np.array([2.9, 1.0])
    poses = poses_reaching(room(shelf), target)
    assert len(poses)
    assert (poses[:, 0] < 3.0).all()
    assert not len(poses_reaching(room(shelf), target, farthest_m=0.46))
    # A narrow piece stands 0.2 m before the shelf: from behind it the shelf is out of sight.
    screen = ((2.4, 0.2, 0), (2.5, 1.8, 0.8))
    x, y, _ = poses_reaching(room(shelf, screen), np.array([2.75, 1.0])).T
    assert not ((x < 2.4) & (np.abs(y - 1.0) < 0.3)).any()


@pytest.mark.assets
def test_an_open_fridge_is_in_the_way(replica_cad):
    layout = Layout.of(load_scene(SceneDataset(replica_cad), "v3_sc1_staging_00"))
    closed = NavigationMap.of_layout(layout)
    opened = NavigationMap.of_layout(layout, {("fridge_:0000", "top_door_hinge"): np.pi / 2})
    # The door is some 0.65 m wide. With the base's radius on both sides, and around its end, it
    # takes about 0.6 * 0.65 + 0.14 = 0.5 m2 of which 0.3 m before the fridge were not free.
    assert 0.15 < CELL_M**2 * (closed.free & ~opened.free).sum() < 0.55
    assert CELL_M**2 * (opened.free & ~closed.free).sum() < 0.1
