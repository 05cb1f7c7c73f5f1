"""The snap grasp in a small scene: grasping, holding and releasing."""

import numpy as np
import pytest
import sapien
from fetch_sim import GRASP, HAND_M, RELEASE, FetchSim

from hab_tasks.robots.grasp import NOTHING
from hab_tasks.world.scenes.physics import HELD, MOVING

SMALL = (0.02, 0.02, 0.02)
SWING = 0.02 * np.array([1, 1, -1, 1, 1, -1, 1])
SHOULDER = np.array([0.01, 0, 0, 0, 0, 0, 0])


def sim_of(*boxes, statics=()):
    return FetchSim("joint_target", boxes, statics)


def move(sim, steps, command, by=0.0):
    """Moves all joints by some radians a step; returns the impulses on the robot [N s]."""
    impulse = 0.0
    for _ in range(steps):
        target = sim.controller.arm_target_rad + by
        impulse += sim.act(np.append(target, 1.0), command)
    return impulse


def groups(sim):
    """The collision groups of the first box."""
    return tuple(sim.objects[0]._bodies[0].collision_shapes[0].get_collision_groups()[:2])


def test_the_nearest_centre_of_mass_within_15_cm_that_is_not_shut_in_is_grasped():
    two = [(SMALL, (0.0, 0.0, -0.05)), (SMALL, (0.0, 0.1, 0.0))]
    # Box 0: centre at 0.14, its surface at 0.04. Box 1: centre at 0.12, its surface at 0.11.
    surfaces = [((0.1, 0.02, 0.02), (0.14, 0.0, 0.0)), ((0.01,) * 3, (0.0, 0.12, 0.0))]
    for boxes, gripper, enclosed, held in (
        ([(SMALL, (0.0, 0.149, 0.0))], 1.0, None, 0),
        ([(SMALL, (0.0, 0.151, 0.0))], 1.0, None, NOTHING),
        ([(SMALL, (0.0, 0.149, 0.0))], 0.0, None, 0),
        ([(SMALL, (0.0, 0.149, 0.0))], -0.01, None, NOTHING),
        (surfaces, 1.0, None, 1),
        (two, 1.0, None, 0),
        (two, 1.0, [True, False], 1),
        (two, 1.0, [True, True], NOTHING),
    ):
        sim = sim_of(*boxes)
        assert np.allclose(sim.grasp.ee_position_m(), HAND_M, atol=1e-4)
        shut_in = None if enclosed is None else enclosed
        sim.grasp.is_enclosed = lambda shut_in=shut_in: shut_in
        sim.grasp.command(gripper)
        assert sim.grasp.held == held, (boxes, gripper, enclosed)
        assert sim.grasp.held_handle == NOTHING


def test_nothing_is_grasped_through_furniture():
    box, shelf = (SMALL, (0.0, 0.0, 0.1)), (0.2, 0.2, 0.01)
    for above_m, held in ((0.05, NOTHING), (0.0, NOTHING), (0.15, 0)):
        sim = sim_of(box, statics=[(shelf, (0.0, 0.0, above_m))])
        sim.grasp.command(GRASP)
        assert sim.grasp.held == held, above_m


def test_a_held_object_keeps_its_place_in_the_hand_and_does_not_push_the_robot():
    # The box reaches into the gripper: it is pushed out if the two meet.
    box = ((0.1, 0.1, 0.1), (0.02, 0.01, -0.03))
    sim = sim_of(box)
    sim.grasp.command(GRASP)
    assert groups(sim) == HELD
    start, before = sim.in_hand(), sim.objects[0].pose.p[0].clone()
    for phase in range(8):
        assert move(sim, 5, GRASP, SWING * np.cos(phase)) == 0.0
        now = sim.in_hand()
        assert np.linalg.norm(now[:3] - start[:3]) < 0.005
        # |q . q'| = cos(angle / 2); 0.0002 is 2.3 degrees
        assert abs(now[3:] @ start[3:]) > 1 - 2e-4
    assert np.linalg.norm(sim.objects[0].pose.p[0] - before) > 0.05, "the arm hardly moved"
    sim.grasp.reset()  # lets go and restores collisions at once
    assert not sim.grasp.holding
    assert not sim.grasp.lost
    assert groups(sim) == MOVING
    assert move(sim_of(box), 3, RELEASE) > 0.0


def test_a_held_object_meets_the_world():
    # A wall 1 cm beside the box; the shoulder turns the arm towards it.
    wall = ((0.3, 0.05, 0.3), (0.0, 0.11, -0.3))
    sim = sim_of(((0.05, 0.05, 0.05), (0.0, 0.0, -0.12)), statics=[wall])
    box, impulse = sim.objects[0]._bodies[0], 0.0
    for _ in range(10):
        move(sim, 1, GRASP, SHOULDER)
        touching = (c for c in sim.scene.px.get_contacts() if box in c.bodies)
        impulse += sum(np.linalg.norm(point.impulse) for c in touching for point in c.points)
    assert impulse > 0


def test_a_released_object_falls_and_collides_once_it_is_clear_of_the_hand():
    sim = sim_of((SMALL, (0.0, 0.0, -0.03)))
    sim.objects[0]._bodies[0].disable_gravity = False
    move(sim, 5, GRASP)
    height = float(sim.objects[0].pose.p[0, 2])
    assert height == pytest.approx(HAND_M[2] - 0.03, abs=0.01)
    move(sim, 1, RELEASE)
    assert sim.grasp.held == NOTHING
    assert groups(sim) == HELD, "it still lies in the hand"
    move(sim, 5, RELEASE)
    # 6 actions are 0.2 s: 9.81 / 2 * 0.2^2 = 0.196 m
    assert float(sim.objects[0].pose.p[0, 2]) == pytest.approx(height - 0.196, abs=0.03)
    assert groups(sim) == MOVING


def test_what_is_pulled_out_of_the_hand_is_lost():
    sim = sim_of((SMALL, (0.0, 0.0, -0.1)))
    sim.grasp.command(GRASP)
    for distance, lost in ((0.08, False), (0.1, True)):
        expected = (sim.agent.ee_link.pose.sp * sim.grasp._ee_from_object).p
        sim.objects[0].set_pose(sapien.Pose(np.add(expected, (0, distance, 0))))
        sim.grasp.after_control_step()
        assert sim.grasp.lost == lost
    assert sim.grasp.held == NOTHING
    sim.grasp.command(RELEASE)
    assert sim.grasp.lost is False
