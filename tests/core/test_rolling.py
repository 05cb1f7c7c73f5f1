"""A lying can stops rolling; with PhysX's persistent contacts it would not (docs/deviations.md)."""

import numpy as np
import sapien
import trimesh
from sapien.physx import PhysxRigidDynamicComponent

from hab_tasks.world.scenes import physics

RADIUS_M, LENGTH_M, SIDES = 0.034, 0.1, 20
"""The embedded soup can."""

SECONDS, FRICTION = 6, 0.8


def test_a_can_stops_within_a_few_sides(tmp_path):
    angles = 2 * np.pi * np.arange(SIDES) / SIDES
    ring = RADIUS_M * np.column_stack((np.cos(angles), np.zeros(SIDES), np.sin(angles)))
    half = np.array((0.0, LENGTH_M / 2, 0.0))
    file = tmp_path / "can.obj"
    trimesh.convex.convex_hull(np.concatenate((ring - half, ring + half))).export(file)
    # At 1 rad/s its energy of 0.75 m r^2 w^2 lifts the axis by 0.09 mm, at 3 rad/s by 0.8 mm. From
    # side to side the axis rises by r (1 - cos 9 deg) = 0.42 mm, and each new side takes energy:
    # it should roll by a few sides of 1.1 cm.
    assert max(rolled_m(str(file), speed) for speed in (1.0, 2.0, 3.0)) < 0.06


def rolled_m(can_file, speed_rad_s):
    scene = physics.bare_scene()
    material = sapien.physx.PhysxMaterial(FRICTION, FRICTION, 0.0)
    floor = scene.create_actor_builder()
    floor.add_box_collision(half_size=[3.0, 3.0, 0.1], material=material)
    floor.initial_pose = sapien.Pose([0.0, 0.0, -0.1])
    floor.build_static("floor")
    builder = scene.create_actor_builder()
    builder.add_convex_collision_from_file(can_file, material=material)
    builder.initial_pose = sapien.Pose([0.0, 0.0, RADIUS_M])
    entity = builder.build("can")._objs[0]
    for _ in range(physics.SIM_HZ // 2):
        scene.px.step()
    body = entity.find_component_by_type(PhysxRigidDynamicComponent)
    body.angular_velocity = [0.0, speed_rad_s, 0.0]
    body.linear_velocity = [speed_rad_s * RADIUS_M, 0.0, 0.0]
    start_m = entity.pose.p
    for _ in range(SECONDS * physics.SIM_HZ):
        scene.px.step()
    return float(np.linalg.norm(entity.pose.p - start_m))
