"""The planners' collision model, compared with contacts in PhysX."""

import numpy as np
import pytest
from hab_spa.planning.collision import ArmCollision, CollisionConfig
from hab_spa.planning.validity import kernel_agreement
from hab_spa.sensing.voxels import voxel_obstacles
from hab_spa.shapes import shape_bounds_m

from hab_tasks.privileged import CollisionShape
from hab_tasks.robots.fetch import FETCH
from hab_tasks.world.scenes.coal_shapes import coal_shape

REST = np.array(FETCH.rest_qpos_rad)


def physx_hits(scene) -> bool:
    """Whether PhysX finds the robot in touch with the scene, or two of its links overlapping."""
    scene.scene.step()
    links = {link.entity.name for link in scene.robot.links}
    arm = {"gripper", "finger", "wrist", "forearm", "elbow", "upperarm", "shoulder"}
    for contact in scene.scene.get_contacts():
        names = [body.entity.name for body in contact.bodies]
        own = [name in links for name in names]
        moves = any(own[i] and any(a in names[i] for a in arm) for i in range(2))
        if moves and any(point.separation < 0.0 for point in contact.points):
            return True
    return False


def disagreements_m(make_scene):
    """Returns how far from touching the shapes are where PhysX and the model differ, of 400 poses.

    Overlaps that PhysX misses are negative.
    """
    scene = make_scene()
    scene.add_table(height_m=0.8, near_m=0.4)
    scene.add_box("shelf", "static", (0.7, 0.0, 1.25), (0.5, 1.2, 0.03))
    scene.add_box("post", "static", (0.45, 0.45, 0.6), (0.06, 0.06, 1.2))
    scene.scene.timestep = 1e-6
    collision = ArmCollision(FETCH, scene.privileged("shelf"), config=CollisionConfig(margin_m=0.0))
    hits, found_m = 0, []
    for pose in np.random.default_rng(0).uniform(
        FETCH.arm_lower_rad, FETCH.arm_upper_rad, (400, 7)
    ):
        scene.set_arm(pose)
        hit = physx_hits(scene)
        hits += hit
        if hit == collision.is_free(pose):
            collision.set_margin(0.01)
            near_m = [contact.distance_m for contact in collision.contacts(pose)]
            collision.set_margin(0.0)
            assert near_m
            found_m.append(min(near_m, key=abs))
    assert 50 < hits < 350
    assert len(found_m) <= 0.01 * 400
    return found_m


@pytest.mark.usefixtures("persistent_contacts")
def test_agrees_with_physx_on_random_poses(make_scene):
    # Where the two differ, the shapes are within a centimetre of touching.
    assert all(abs(gap_m) < 0.01 for gap_m in disagreements_m(make_scene))


def test_the_kernel_answers_as_coal_does_near_contact_too(shelf_state):
    cloud_m = np.random.default_rng(0).uniform((0.35, 0.15, 0.85), (0.65, 0.45, 1.15), (400, 3))
    voxels = voxel_obstacles(np.floor(cloud_m / 0.012) * 0.012 + 0.006, 0.012, cell_m=0.2)
    model = ArmCollision(FETCH, shelf_state, obstacles=voxels)
    for margin_m in (0.02, 0.0):
        model.set_margin(margin_m)
        poses, different, false_free = kernel_agreement(model, 400, seed=0)
        assert (poses > 500, different, false_free) == (True, 0, 0)


def test_relax_frees_a_pose_and_only_its_own_pairs(table_scene):
    state = table_scene.privileged("target")
    collision = ArmCollision(FETCH, state)
    rng = np.random.default_rng(2)
    contacts = []
    while not any("table" in contact.second + contact.first for contact in contacts):
        pose = rng.uniform(FETCH.arm_lower_rad, FETCH.arm_upper_rad)
        contacts = collision.contacts(pose)
    collision.relax(pose)
    assert collision.is_free(pose)
    untouched = ArmCollision(FETCH, state)
    others = rng.uniform(FETCH.arm_lower_rad, FETCH.arm_upper_rad, (200, 7))
    pairs = {contact.pair for contact in contacts}
    for other in others:
        if not {contact.pair for contact in untouched.contacts(other)} <= pairs:
            assert not collision.is_free(other)


def test_held_object_changes_validity_and_never_collides_with_the_robot(table_scene):
    """A stick 0.5 m below the gripper, as if in its grasp."""
    empty = ArmCollision(FETCH, table_scene.privileged("target"))
    ee = table_scene.robot.find_link_by_name("gripper_link").entity_pose.p
    table_scene.add_box("stick", "object", (ee[0], ee[1], ee[2] - 0.2), (0.03, 0.03, 0.3))
    loaded = ArmCollision(FETCH, table_scene.privileged("stick", held="stick"), held="stick")
    poses = np.random.default_rng(3).uniform(FETCH.arm_lower_rad, FETCH.arm_upper_rad, (600, 7))
    free_empty = np.array([empty.is_free(pose) for pose in poses])
    free_loaded = np.array([loaded.is_free(pose) for pose in poses])
    assert (free_empty & ~free_loaded).any()
    # The object can only take poses away: it stood far from the arm before.
    assert not (~free_empty & free_loaded).any()
    touched = {
        other
        for pose in poses[~free_loaded]
        for contact in loaded.contacts(pose)
        for other in (contact.first, contact.second)
        if "stick" in contact.first + contact.second
    }
    assert touched
    assert not any(name.startswith("hab_fetch") for name in touched)


def test_primitive_shapes_have_the_same_extent_in_coal():
    none = {"vertices_m": np.zeros((0, 3)), "faces": np.zeros((0, 3), dtype=np.int64)}
    for kind, half_size_m, expected_m in (
        ("box", (0.1, 0.2, 0.3), (0.1, 0.2, 0.3)),
        ("sphere", (0.1, 0.0, 0.0), (0.1, 0.1, 0.1)),
        ("capsule", (0.1, 0.3, 0.0), (0.4, 0.1, 0.1)),
        ("cylinder", (0.1, 0.3, 0.0), (0.3, 0.1, 0.1)),
    ):
        half_m = np.array(half_size_m)
        shape = CollisionShape(kind=kind, body_from_shape=np.eye(4), half_size_m=half_m, **none)
        np.testing.assert_allclose(shape_bounds_m(shape), [-np.array(expected_m), expected_m])
        geometry, shape_from_coal = coal_shape(shape)
        geometry.computeLocalAABB()
        corners = np.array([geometry.aabb_local.min_, geometry.aabb_local.max_])
        turned = corners @ shape_from_coal[:3, :3].T + shape_from_coal[:3, 3]
        np.testing.assert_allclose(np.abs(turned), np.abs([expected_m, expected_m]), atol=1e-6)
