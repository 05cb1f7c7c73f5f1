"""Geodesic distances of a batch, compared with the distance field of each row's map."""

import numpy as np
import pytest
from geodesics import geodesic_distance

from hab_tasks.engine.measures import GeodesicDistances
from hab_tasks.world.navigation import NavigationMap
from hab_tasks.world.scenes.floor import floor_between

GOALS = np.array(((5.2, 0.8), (-9.0, 6.0), (2.5, 3.5)))


def floor(*boxes):
    """The map of a floor with obstacles on it, each (low x, low y, high x, high y) [m]."""
    shapes = [np.array(((a, b), (c, b), (c, d), (a, d))) for a, b, c, d in boxes]
    found = floor_between(shapes[1:], shapes[0])
    return NavigationMap(found, np.zeros_like(found.room))


@pytest.fixture(scope="module")
def maps():
    """A hall with a wall in it, a square elsewhere, a corridor: shapes and origins all differ."""
    hall = floor((0.0, 0.0, 6.0, 4.0), (3.0, 0.0, 3.1, 2.5))
    return (hall, floor((-10.0, 5.0, -7.0, 8.0)), floor((2.0, -3.0, 3.0, 4.5)))


@pytest.fixture
def geodesic(maps):
    geodesic = GeodesicDistances(len(maps))
    for row, (map_, goal) in enumerate(zip(maps, GOALS, strict=True)):
        geodesic.set_goal(row, map_, goal)
    return geodesic


def distances_m(geodesic, places):
    """Distances (N,) [m] of places (N, 2)."""
    found = geodesic.distance_m(np.array(places, dtype=np.float32))
    assert found.dtype == np.float32
    assert found.shape == (len(places),)
    return found


def test_each_row_has_the_distances_of_its_own_map(maps, geodesic):
    rng, cells = np.random.default_rng(0), [np.argwhere(map_.free) for map_ in maps]
    fields = [map_.geodesic_field(goal) for map_, goal in zip(maps, GOALS, strict=True)]
    for _ in range(200):
        places = [m.positions(rng.choice(c)) for m, c in zip(maps, cells, strict=True)]
        places += rng.uniform(-0.02, 0.02, (len(maps), 2))
        rows = zip(maps, places, fields, strict=True)
        # Beside obstacles the map uses a free cell and the batch interpolates between four.
        expected = [float(geodesic_distance(*row)) for row in rows]
        assert distances_m(geodesic, places) == pytest.approx(expected, abs=0.05)


def test_a_new_goal_in_one_row_leaves_the_others(maps, geodesic):
    places = [(1.0, 1.0), (-8.0, 6.5), (2.5, 0.0)]
    before = distances_m(geodesic, places)
    geodesic.set_goal(1, maps[1], np.array((-8.0, 7.5)))
    after = distances_m(geodesic, places)
    assert after.tolist() == [before[0], pytest.approx(1.0, abs=0.03), before[2]]
    # Another map altogether, larger than all before.
    geodesic.set_goal(2, floor((-20.0, -20.0, 5.0, 5.0)), np.array((0.0, 0.0)))
    again = distances_m(geodesic, places)
    assert again.tolist() == [before[0], after[1], pytest.approx(2.5, abs=0.03)]


def test_in_walls_in_corners_and_outside_the_map_distances_are_finite(geodesic):
    for places in (
        [(3.05, 1.0), (-9.99, 5.01), (2.01, 4.49)],
        [(-5.0, 2.0), (-100.0, 100.0), (2.5, 50.0)],
    ):
        found = distances_m(geodesic, places)
        assert np.isfinite(found).all()
        assert (found > 0).all()
