"""Perception of SPA: depth images, voxels, fitted boxes and contact detection."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hab_eval.cli import main
from hab_spa.motion.follow import FollowConfig, Follower
from hab_spa.planning.collision import ArmCollision, CollisionConfig
from hab_spa.sensing.cloud import DepthView, world_from_base
from hab_spa.sensing.fitted_box import BoxConfig, fit_box, other_things_m
from hab_spa.sensing.seen_map import MapConfig, SeenMap
from hab_spa.sensing.voxels import (
    VoxelConfig,
    VoxelMap,
    first_in_voxels,
    voxel_keys,
    voxel_obstacles,
)

from hab_tasks.robots.cameras import camera_pose
from hab_tasks.robots.fetch import FETCH

LOOKS_DOWN = np.array(
    # Columns: the image's right, its down and its ahead; x ahead of the robot is up in the image.
    ((0.0, -1.0, 0.0, 0.0), (-1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
)


def view_from(height_m: float, depth_m: np.ndarray, focal_px: float = 8.0) -> DepthView:
    """A camera that looks straight down from above the origin."""
    pose = LOOKS_DOWN.copy()
    pose[2, 3] = height_m
    rows, columns = depth_m.shape
    return DepthView(
        depth_m=depth_m,
        focal_px=np.array((focal_px, focal_px)),
        centre_px=np.array((columns / 2, rows / 2)),
        world_from_camera=pose,
    )


def test_pixels_become_points():
    view = view_from(2.0, np.array(((1.0, 2.0), (np.inf, 4.0))), focal_px=1.0)
    points = view.points_m
    # Row 0, column 0 is half a pixel left and up of the axis: camera (-0.5, -0.5, 1) * 1 m. Left
    # is +y of the world and up is +x; 1 m below a camera at 2 m is z = 1.
    np.testing.assert_allclose(points[0, 0], (0.5, 0.5, 1.0))
    # Right and up, 2 m away: camera (1, -1, 2).
    np.testing.assert_allclose(points[0, 1], (1.0, -1.0, 0.0))
    # Right and down, 4 m away: camera (2, 2, 4).
    np.testing.assert_allclose(points[1, 1], (-2.0, -2.0, -2.0))
    assert np.isnan(points[1, 0]).all()


def test_an_observation_gives_the_image_and_where_the_robot_is():
    base = np.eye(4)
    base[:2, :2] = ((0.0, -1.0), (1.0, 0.0))  # turned left by a quarter
    base[:3, 3] = 3.0, -2.0, 0.005
    base_from_sapien = camera_pose(FETCH.cameras["head"]).to_transformation_matrix().astype(float)
    camera = base @ base_from_sapien
    # SAPIEN's x, y, z are ahead, left, up; a depth image's are right, down, ahead.
    axes = np.stack((-camera[:3, 1], -camera[:3, 2], camera[:3, 0]))
    extrinsic = np.concatenate((axes, -axes @ camera[:3, 3:]), axis=1)
    # Half of 10 m, and nothing within 10 m.
    depth = np.array((((0.5,), (1.0,)),))[None]
    obs = {
        "sensor_data": {"head": {"depth": depth}},
        "sensor_param": {
            "head": {
                "extrinsic_cv": extrinsic[None],
                "intrinsic_cv": np.array(((4.0, 0.0, 1.0), (0.0, 4.0, 0.5), (0.0, 0.0, 1.0)))[None],
            }
        },
    }
    np.testing.assert_allclose(world_from_base(FETCH, obs, 0), base, atol=1e-9)
    view = DepthView.read(obs, "head", 0)
    np.testing.assert_array_equal(view.depth_m, ((5.0, np.inf),))
    np.testing.assert_array_equal(view.focal_px, (4.0, 4.0))
    np.testing.assert_array_equal(view.centre_px, (1.0, 0.5))


def test_voxels_that_a_view_sees_through_are_emptied():
    voxels = VoxelMap(VoxelConfig(size_m=0.1, through_m=0.15))
    same = (0.01, 0.02, 0.53), (0.04, 0.07, 0.58)
    voxels.add(np.array((*same, (0.01, 0.0, -0.25), (3.0, 0.0, 0.5))))
    # Two points share a voxel, whose centre is (0.05, 0.05, 0.55).
    assert len(voxels) == 3
    assert any(np.allclose(centre, (0.05, 0.05, 0.55)) for centre in voxels.centres_m())
    voxels.carve(view_from(1.0, np.full((16, 16), 0.9)))
    left = sorted(voxels.centres_m().tolist())
    # Floor at z = 0.1: the camera sees through the first one; the second is behind the floor, the
    # third beside the picture.
    np.testing.assert_allclose(left, ((0.05, 0.05, -0.25), (3.05, 0.05, 0.55)))


def test_what_hides_behind_a_surface_is_not_free_until_seen():
    config = MapConfig(behind_m=0.3, hidden=VoxelConfig(size_m=0.03, through_m=0.03))
    seen = SeenMap(config)
    depth_m = np.full((64, 64), 1.0)
    depth_m[24:40, 24:40] = 0.5  # something 0.5 m above the floor, 0.25 m wide
    seen.add(view_from(1.0, depth_m, focal_px=32.0), np.ones((64, 64), dtype=bool))
    hidden = seen.hidden_m(np.zeros(3), 1.0)
    middle = hidden[(np.abs(hidden[:, :2]) < 0.1).all(axis=1), 2]
    assert ((middle > 0.25) & (middle < 0.45)).sum() > 100
    # Nothing but what is below it and below the floor is hidden.
    assert (hidden[np.abs(hidden[:, 0]) > 0.4, 2] < 0.0).all()
    # From the side one looks below it, at a wall 2 m away.
    side = view_from(0.0, np.full((64, 64), 2.0), focal_px=32.0)
    pose = np.eye(4)
    pose[:3, :3] = ((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0))
    pose[:3, 3] = -1.0, 0.0, 0.3
    seen.add(replace(side, world_from_camera=pose), np.ones((64, 64), dtype=bool))
    hidden = seen.hidden_m(np.zeros(3), 1.0)
    assert not ((np.abs(hidden[:, :2]) < 0.1).all(axis=1) & (hidden[:, 2] > 0.05)).any()


def test_voxels_tell_what_the_true_shapes_tell(table_scene):
    state = table_scene.privileged("target")
    gone = {"table", "leg-0.55", "leg+0.55", "target", "clutter0", "clutter1"}
    assert gone < state.world_from_body.keys()
    bare = {name: pose for name, pose in state.world_from_body.items() if name not in gone}
    only = {n: p for n, p in state.world_from_body.items() if n in bare or n == "table"}
    voxels = VoxelMap(VoxelConfig(size_m=0.01))
    centre, half = np.array((0.75, 0.0, 0.73)), np.array((0.299, 0.6, 0.019))
    voxels.add(box_from_the_front(centre, half, 0.01))
    voxels.add(box_from_the_front(centre, half * (1, 1, -1), 0.01))  # the lower side
    config = CollisionConfig(margin_m=0.0)
    obstacles = voxel_obstacles(voxels.centres_m(), 0.01, cell_m=0.2)
    seen = ArmCollision(
        FETCH, replace(state, world_from_body=bare), config=config, obstacles=obstacles
    )
    true = ArmCollision(FETCH, replace(state, world_from_body=only), config=config)
    poses = np.random.default_rng(1).uniform(FETCH.arm_lower_rad, FETCH.arm_upper_rad, (600, 7))
    differ = [pose for pose in poses if seen.is_free(pose) != true.is_free(pose)]
    hits = sum(not true.is_free(pose) for pose in poses)
    assert 100 < hits < 500
    # Voxels reach up to 1 cm beyond the surface; and what is in the table whole is not seen.
    assert len(differ) <= 0.05 * len(poses)
    true.set_margin(0.02)
    assert all(not true.is_free(pose) for pose in differ)


def box_from_the_front(centre, half, step_m=0.005) -> np.ndarray:
    """Points on the top and the front (-x) of a box along the axes."""
    y, z = np.meshgrid(*(np.arange(-h, h + 1e-9, step_m) for h in half[1:]))
    front = np.stack((np.full_like(y, -half[0]), y, z), axis=-1).reshape(-1, 3)
    x, y = np.meshgrid(*(np.arange(-h, h + 1e-9, step_m) for h in half[:2]))
    top = np.stack((x, y, np.full_like(x, half[2])), axis=-1).reshape(-1, 3)
    return np.array(centre) + np.concatenate((front, top))


def plane(height_m: float) -> np.ndarray:
    x, y = np.meshgrid(np.arange(0.4, 1.2, 0.01), np.arange(-0.5, 0.5, 0.01))
    return np.stack((x, y, np.full_like(x, height_m)), axis=-1).reshape(-1, 3)


UP, BESIDE = np.array((0.0, 0.0, 1.0)), np.array((0.0, 0.085, 0.0))
CENTRE, HALF = np.array((0.8, 0.1, 0.8)), np.array((0.03, 0.04, 0.05))


def test_a_box_is_fitted_to_what_stands_on_a_plane():
    points = np.concatenate((plane(0.75), box_from_the_front(CENTRE, HALF)))
    box = fit_box(points, CENTRE, np.zeros(3), BoxConfig())
    assert box.seen
    assert box.support_m == pytest.approx(0.75, abs=1e-9)
    np.testing.assert_allclose(box.world_from_box[:3, 3], CENTRE, atol=0.006)
    np.testing.assert_allclose(box.half_size_m, HALF, atol=0.006)
    top, *sides = box.upper_face_centres_m()
    np.testing.assert_allclose(top, CENTRE + UP * 0.05, atol=0.006)
    assert all(abs(side[2] - 0.8) < 0.006 for side in sides)
    inside = box.contains(np.stack((CENTRE, CENTRE + UP * 0.08)), 0.01)
    assert inside.tolist() == [True, False]
    # A neighbour that touches makes it no wider.
    points = np.concatenate((points, box_from_the_front(CENTRE + BESIDE, HALF)))
    box = fit_box(points, CENTRE, np.array((0.0, 0.1, 1.2)), BoxConfig())
    assert box.half_size_m[:2].max() < 0.065
    (other,) = other_things_m(points, CENTRE, box, BoxConfig())
    assert np.linalg.norm(other - (CENTRE + BESIDE)) < 0.04
    # Without points it is the smallest, at the place told.
    box = fit_box(plane(0.5), CENTRE, np.zeros(3), BoxConfig())
    assert not box.seen
    np.testing.assert_allclose(box.world_from_box[:3, 3], CENTRE)
    np.testing.assert_allclose(box.half_size_m, 0.02)


def test_the_arm_feels_when_it_is_held_up():
    """Joints follow as the drives do in free air, until one is blocked."""
    targets = np.linspace(0.0, 1.0, 30)[:, None] * np.linspace(0.2, 1.0, 7)
    for blocked_from in (99, 10):
        follower = Follower(targets, FollowConfig(bump_rad=0.008))
        qpos, step, felt = np.zeros(7), np.zeros(7), []
        for i in range(20):
            target = follower.advance(qpos)
            felt.append(follower.bumped)
            step = 0.33 * (target - qpos) + 0.17 * step
            step[6] *= i < blocked_from
            qpos = qpos + step
        # Blocked in step 10, which is felt when the arm is asked for the next one.
        assert felt.index(True) == 11 if blocked_from < 20 else not any(felt)


@pytest.mark.slow
@pytest.mark.render
def test_spa_picks_from_depth_alone(tmp_path):
    out = tmp_path / "run"
    options = ["--agent", "hab_spa:spa", "--env", "HabPick-v1", "--episodes", "3"]
    assert main(["run", *options, "--out", str(out)]) in (0, None)
    record = json.loads((out / "run.json").read_text())
    assert record["privileged"] is False
    assert sum(episode["success"] for episode in record["episodes"]) >= 2


def test_one_point_of_each_voxel_is_the_first_in_it():
    # A dense cloud around the origin, so that indices are of both signs.
    points_m = np.random.default_rng(0).normal(scale=0.1, size=(200_000, 3))
    _, first = np.unique(voxel_keys(points_m, 0.02), return_index=True)
    assert first_in_voxels(points_m, 0.02).tolist() == sorted(first.tolist())
    assert not len(first_in_voxels(points_m[:0], 0.02))
    voxels = VoxelMap(VoxelConfig(size_m=0.02))
    for part in np.split(points_m, 4):
        voxels.add(part)
    assert len(voxels) == len(first)
