"""The human-render camera stays beside the robot, and moves where a wall comes between."""

from types import SimpleNamespace

import numpy as np
import pytest

from hab_tasks.privileged import CollisionBody, CollisionShape
from hab_tasks.skills.viewpoint import CANDIDATES_M, Viewpoint


def box(name, middle_m, half_m):
    pose = np.eye(4)
    pose[:3, 3] = middle_m
    shape = CollisionShape(
        kind="box",
        body_from_shape=pose,
        half_size_m=np.array(half_m),
        vertices_m=np.zeros((0, 3)),
        faces=np.zeros((0, 3), dtype=np.int64),
    )
    return CollisionBody(name=name, group="stage", shapes=(shape,))


# A floor of 12 m x 12 m and a wall of 10 cm at x = -0.85.
BODIES = (box("floor", (0, 0, -0.1), (6, 6, 0.1)), box("wall", (-0.85, 0, 1.25), (0.05, 6, 1.25)))
STATE = SimpleNamespace(bodies=BODIES, world_from_body={b.name: np.eye(4) for b in BODIES})


class World:
    """A robot in a room, without a simulation."""

    def __init__(self):
        self.read = 0

    def at(self, x, y, yaw, episode="a", layout="room"):
        self.snapshot = SimpleNamespace(base=np.array([[x, y, yaw]]))
        self.episodes = [SimpleNamespace(id=episode, scene_id=layout)]
        return self

    def privileged(self):
        self.read += 1
        return [STATE]


def place(pose):
    """Which of the candidates a pose is."""
    return CANDIDATES_M.index(tuple(round(float(v), 6) for v in pose.p[:2]))


@pytest.fixture
def world():
    return World()


def test_the_best_place_is_taken_where_nothing_is_near(world):
    assert place(Viewpoint().follow(world.at(3, 0, 0))) == 0


def test_a_place_behind_a_wall_is_not_taken(world):
    # Facing away from the wall, the first two places, 1.4 m behind, are on its other side; the
    # third is 0.5 m behind.
    assert place(Viewpoint().follow(world.at(0, 0, 0))) == 2


def test_the_camera_moves_only_when_a_wall_comes_between(world):
    view = Viewpoint()
    assert place(view.follow(world.at(3, 0, 0))) == 0
    # The camera is at x = 1.6, then 0.1.
    assert view.follow(world.at(3, 0, 0)) is None
    assert view.follow(world.at(1.5, 0, 0)) is None
    # At x = -1.4 it would be behind the wall.
    assert place(view.follow(world.at(0, 0, 0))) == 2
    # It stays there when the first place is free again, until the next episode.
    assert view.follow(world.at(3, 0, 0)) is None
    assert place(view.follow(world.at(3, 0, 0, episode="b"))) == 0


def test_a_layout_is_read_once(world):
    view = Viewpoint()
    for x in (3.0, 2.0, 1.0):
        view.follow(world.at(x, 0, 0))
    assert world.read == 1
    view.follow(world.at(3, 0, 0, episode="b", layout="another"))
    assert world.read == 2
