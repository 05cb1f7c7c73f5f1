"""The scene as estimated by SPA: obstacles and object positions."""

import numpy as np
import pytest
from hab_spa.planning.ik import BatchArm
from hab_spa.scenes.seen_config import SeenConfig
from hab_spa.scenes.seen_scene import SeenScene
from hab_spa.scenes.seen_shelves import are_parted
from hab_spa.sensing.fitted_box import BoxConfig, HeldBox
from hab_spa.sensing.known_fridge import bodies

from hab_tasks.robots.cameras import camera_pose
from hab_tasks.robots.fetch import FETCH

REST = np.array(FETCH.rest_qpos_rad)
ASIDE = REST + np.array((0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
"""The shoulder turned, so that the hand is about half a metre to the left."""

FOCAL_PX = 64.0


def observation(wall_m):
    """One row's images: a wall so far ahead of the head's camera, nothing before the hand's."""
    depth = np.ones((1, 128, 128, 1))
    depth[..., 0] = wall_m / 10.0
    base_from_sapien = camera_pose(FETCH.cameras["head"]).to_transformation_matrix().astype(float)
    axes = np.stack((-base_from_sapien[:3, 1], -base_from_sapien[:3, 2], base_from_sapien[:3, 0]))
    extrinsic = np.concatenate((axes, -axes @ base_from_sapien[:3, 3:]), axis=1)
    intrinsic = np.array(((FOCAL_PX, 0.0, 64.0), (0.0, FOCAL_PX, 64.0), (0.0, 0.0, 1.0)))
    parameters = {"extrinsic_cv": extrinsic[None], "intrinsic_cv": intrinsic[None]}
    return {
        "agent": {"arm_qpos": REST[None], "is_holding": np.zeros((1, 1))},
        "extra": {"object_start_from_ee": np.ones((1, 3))},
        "sensor_data": {"head": {"depth": depth}, "arm": {"depth": np.ones((1, 128, 128, 1))}},
        "sensor_param": {"head": parameters, "arm": parameters},
    }


@pytest.fixture
def scene():
    """A robot at the origin that sees nothing within 10 m."""
    scene = SeenScene(FETCH, SeenConfig(watch_steps=1))
    scene.see(observation(wall_m=10.0), 0)
    scene.collision()
    return scene


def test_only_what_was_seen_since_the_plan_is_in_the_way(scene):
    path = np.linspace(REST, ASIDE, 20)
    assert not scene.in_the_way(path)
    hand_m = BatchArm(FETCH).ee_pose(ASIDE)[:3, 3]
    # How far ahead of the head's camera the hand will be: a wall there is where it goes.
    camera = camera_pose(FETCH.cameras["head"]).to_transformation_matrix().astype(float)
    ahead_m = float(camera[:3, 0] @ (hand_m - camera[:3, 3]))
    scene.see(observation(wall_m=ahead_m), 0)
    assert scene.in_the_way(path)
    assert not scene.in_the_way(path[:2])  # so far it is free
    scene.collision()  # what is planned now knows the wall
    assert not scene.in_the_way(path)


def test_a_robot_that_drives_sees_what_it_would_drive_into(scene):
    # It rolls 1 m ahead, to where the hand would be in a wall at 0.9 m.
    ahead = np.column_stack((np.linspace(0.0, 1.0, 11), np.zeros((11, 2))))
    assert not scene.drives_into(ahead)
    camera = camera_pose(FETCH.cameras["head"]).to_transformation_matrix().astype(float)
    seen = observation(wall_m=float(camera[:3, 0] @ ((0.9, 0.0, 0.8) - camera[:3, 3])))
    seen["sensor_data"]["arm"] = seen["sensor_data"]["head"]  # else the hand sees through the wall
    scene.see(seen, 0)
    assert scene.drives_into(ahead)
    assert not scene.drives_into(ahead[:1])  # here it stands free


def test_nothing_is_grasped_through_a_shelf():
    # A bowl at 1.27 m stands on the shelf at 1.24 m, 0.3 m behind the front.
    bowl_m, hands_m = (
        np.array((-0.3, 0.35, 1.27)),
        np.array(((-0.25, 0.35, 1.35), (-0.3, 0.35, 1.16))),
    )
    body, _ = bodies(1)
    assert are_parted(hands_m, bowl_m, body, np.eye(4)).tolist() == [False, True]


def test_the_box_of_a_held_object_is_as_it_stood_when_it_was_picked():
    """A cracker box, 7 x 16 x 21 cm, that the hand has tilted by 45 degrees around y."""
    half_m = np.array((0.035, 0.08, 0.105))
    points_m = np.random.default_rng(0).uniform(-half_m, half_m, (4000, 3))
    side = np.arange(4000) % 3
    points_m[np.arange(4000), side] = np.copysign(half_m[side], points_m[np.arange(4000), side])
    world_from_ee = np.eye(4)
    world_from_ee[:3, :3] = ((0.5**0.5, 0, 0.5**0.5), (0, 1, 0), (-(0.5**0.5), 0, 0.5**0.5))
    tilted_m = points_m @ world_from_ee[:3, :3].T
    held = HeldBox.find(tilted_m, world_from_ee, BoxConfig(), np.array((0.0, 0.0, 1.0)))
    assert held is not None
    assert np.sort(held.half_size_m) == pytest.approx(half_m, abs=0.002)
    upright = HeldBox.find(tilted_m, world_from_ee, BoxConfig())
    assert upright is not None
    # (7 + 21) cm / 2 / sqrt(2) = 9.9 cm, two times.
    assert np.sort(upright.half_size_m) == pytest.approx((0.08, 0.099, 0.099), abs=0.003)
