"""The human-render camera stays beside the robot, and moves if the hand is occluded."""

from types import SimpleNamespace

import numpy as np
import sapien
from sapien.physx import PhysxCollisionShapeBox, PhysxCpuSystem, PhysxRigidStaticComponent

from hab_tasks.engine.viewpoint import CANDIDATES_M, Viewpoint


class EpisodeSimulation:
    """A robot's base, its hand and boxes around it, with PhysX to cast the rays."""

    def __init__(self):
        self._scene = sapien.Scene([PhysxCpuSystem()])

    def add_box(self, name, middle_m, half_m):
        body = PhysxRigidStaticComponent()
        body.attach(PhysxCollisionShapeBox(list(half_m), sapien.physx.get_default_material()))
        entity = sapien.Entity()
        entity.name = name
        entity.add_component(body)
        entity.set_pose(sapien.Pose(list(middle_m)))
        self._scene.add_entity(entity)
        self._scene.physx_system.step()
        return entity

    def at(self, x, episode="a"):
        """The robot stands at (x, 0) and faces +x, its hand 0.7 m ahead."""
        base, ee_m = np.array([[x, 0.0, 0.0]]), np.array([[x + 0.7, 0.0, 0.9]])
        self.snapshot = SimpleNamespace(base=base, ee_m=ee_m)
        self.episodes = [SimpleNamespace(id=episode)]
        return self

    def held_name(self):
        return None

    def cast(self, origin_m, direction, length_m):
        origin_m, direction = (v.astype(np.float32) for v in (origin_m, direction))
        hit = self._scene.physx_system.raycast(origin_m, direction, length_m)
        return None if hit is None else (hit.distance, hit.component.entity.name)


def place(pose):
    """Which of the candidates a pose is."""
    return CANDIDATES_M.index(tuple(round(float(v), 6) for v in pose.p))


def test_the_camera_moves_only_when_something_comes_between():
    # A floor of 12 m x 12 m and a wall of 10 cm at x = -0.85.
    world = EpisodeSimulation()
    world.add_box("floor", (0, 0, -0.1), (6, 6, 0.1))
    world.add_box("wall", (-0.85, 0, 1.25), (0.05, 6, 1.25))
    view = Viewpoint()
    # The best place is taken where nothing is near.
    assert place(view.follow(world.at(3), world.cast)) == 0
    # The camera is at x = 1.6, then 0.1.
    assert view.follow(world.at(3), world.cast) is None
    assert view.follow(world.at(1.5), world.cast) is None
    # Facing away from the wall, the first two places, 1.4 m behind, are on its other side; the
    # third is 0.5 m behind.
    assert place(view.follow(world.at(0), world.cast)) == 2
    # It stays there when the first place is free again, until the next episode.
    assert view.follow(world.at(3), world.cast) is None
    assert place(view.follow(world.at(3, episode="b"), world.cast)) == 0
    # A door of 0.9 m x 1.8 m to the left of the hand, at (3.7, 0, 0.9). The camera is at
    # (1.6, 1.1, 2.1), so its view crosses the door's plane, y = 0.25, at x = 3.22, z = 1.17.
    door = world.add_box("fridge/door", (3.45, 0.25, 0.9), (0.45, 0.02, 0.9))
    # It moves to the other side of the door.
    assert place(view.follow(world.at(3), world.cast)) == 1
    # Shut again, it changes nothing.
    door.set_pose(sapien.Pose([6, 0, 0.9]))
    assert view.follow(world.at(3), world.cast) is None
