"""Geodesic distances of a batch, compared with the distance field of each row's map."""

import numpy as np
import pytest
import torch
from geodesics import geodesic_distance

from hab_tasks.navigation import GeodesicDistances, NavigationMap
from hab_tasks.scenes.floor import floor_between

GOALS = ((5.2, 0.8), (-9.0, 6.0), (2.5, 3.5))


def rectangle(low_x, low_y, high_x, high_y):
    return np.array([(low_x, low_y), (high_x, low_y), (high_x, high_y), (low_x, high_y)])


def floor(low, high, *obstacles):
    """The map of a floor between two corners [m] with obstacles on it."""
    corners = rectangle(*low, *high)
    found = floor_between([rectangle(*o) for o in obstacles], corners)
    return NavigationMap(found, np.zeros_like(found.room))


@pytest.fixture(scope="module")
def maps():
    """A hall with a wall in it, a square elsewhere, a corridor: shapes and origins all differ."""
    return (
        floor((0.0, 0.0), (6.0, 4.0), (3.0, 0.0, 3.1, 2.5)),
        floor((-10.0, 5.0), (-7.0, 8.0)),
        floor((2.0, -3.0), (3.0, 4.5)),
    )


def distances_m(geodesic, places):
    """Distances (N,) [m] of places (N, 2), found with arrays; tensors must agree."""
    places = np.array(places, dtype=np.float32)
    arrays, tensors = geodesic.distance_m(places), geodesic.distance_m(torch.from_numpy(places))
    assert arrays.dtype == np.float32
    assert tensors.dtype == torch.float32
    assert arrays.shape == tensors.shape == (len(places),)
    # Sums of four products of float32, in another order.
    assert np.allclose(tensors.numpy(), arrays, atol=1e-5)
    return arrays


def geodesic_to(maps):
    geodesic = GeodesicDistances(len(maps))
    for row, (map_, goal) in enumerate(zip(maps, GOALS, strict=True)):
        geodesic.set_goal(row, map_, np.array(goal))
    return geodesic


def free_points(map_, count, rng):
    cells = np.argwhere(map_.free)
    points = map_.positions(cells[rng.integers(len(cells), size=count)])
    return points + rng.uniform(-0.02, 0.02, (count, 2))


def test_each_row_has_the_distances_of_its_own_map(maps):
    geodesic, rng = geodesic_to(maps), np.random.default_rng(0)
    points = [free_points(map_, 200, rng) for map_ in maps]
    fields = [map_.geodesic_field(np.array(g)) for map_, g in zip(maps, GOALS, strict=True)]
    for places in zip(*points, strict=True):
        found = distances_m(geodesic, places)
        for row, (map_, field) in enumerate(zip(maps, fields, strict=True)):
            expected = geodesic_distance(map_, places[row], field)
            # Beside obstacles the map uses a free cell and the batch interpolates between four.
            assert float(found[row]) == pytest.approx(float(expected), abs=0.05)


def test_a_new_goal_in_one_row_leaves_the_others_and_without_one_there_is_no_way(maps):
    geodesic = geodesic_to(maps)
    places = [(1.0, 1.0), (-8.0, 6.5), (2.5, 0.0)]
    before = distances_m(geodesic, places)
    geodesic.set_goal(1, maps[1], np.array((-8.0, 7.5)))
    after = distances_m(geodesic, places)
    assert after.tolist() == [before[0], pytest.approx(1.0, abs=0.03), before[2]]
    # Another map altogether, larger than all before.
    big = floor((-20.0, -20.0), (5.0, 5.0))
    geodesic.set_goal(2, big, np.array((0.0, 0.0)))
    again = distances_m(geodesic, places)
    assert again.tolist() == [before[0], after[1], pytest.approx(2.5, abs=0.03)]
    geodesic.clear(1)
    assert distances_m(geodesic, places).tolist() == [before[0], 0.0, again[2]]


def test_beside_and_outside_the_free_floor_distances_are_finite(maps):
    geodesic = geodesic_to(maps)
    # In the wall, in a corner where the base does not fit, and outside the map.
    for places in (
        [(3.05, 1.0), (-9.99, 5.01), (2.01, 4.49)],
        [(-5.0, 2.0), (-100.0, 100.0), (2.5, 50.0)],
    ):
        found = distances_m(geodesic, places)
        assert np.isfinite(found).all()
        assert (found > 0).all()


def test_distances_shrink_on_the_way_to_the_goal(maps):
    geodesic = geodesic_to(maps)
    steps = [
        float(distances_m(geodesic, [(0.5, 0.5), (-9.0, y), (2.5, 0.0)])[1])
        for y in np.linspace(7.5, 6.1, 50)
    ]
    # Every step is 1.4 / 49 = 0.0286 m.
    assert np.diff(steps) == pytest.approx(-0.0286, abs=0.004)
