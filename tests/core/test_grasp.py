"""The snap grasp in a small scene: grasping, holding and releasing; both implementations."""

from functools import partial

import numpy as np
import pytest
import sapien
import torch
from builders import box_actor
from fetch_sim import GRASP, HAND_M, RELEASE, FetchSim
from kitchen import Kitchen, opening_direction

from hab_tasks.robots.drive_grasp import DriveGrasp
from hab_tasks.robots.follow_grasp import FollowGrasp
from hab_tasks.robots.grasp import NOTHING
from hab_tasks.scenes.collision_groups import HELD, MOVING
from hab_tasks.scenes.habitat.dataset import resolve_dataset
from hab_tasks.scenes.habitat.load import load_scene
from hab_tasks.scenes.markers import HANDLE_MARKERS

KINDS = {DriveGrasp: 0.005, FollowGrasp: 0.001}
"""Implementation -> how far [m] a held object may leave its place in the hand."""

every_kind = pytest.mark.parametrize("kind", KINDS)
SMALL = (0.02, 0.02, 0.02)
SWING = 0.02 * np.array([1, 1, -1, 1, 1, -1, 1])
SHOULDER = np.array([0.01, 0, 0, 0, 0, 0, 0])
DRAWER, FRIDGE = HANDLE_MARKERS[2], HANDLE_MARKERS[7]
drawer_and_door = pytest.mark.parametrize("marker", [DRAWER, FRIDGE], ids=lambda m: m.name)


def sim_of(kind, boxes, statics=()):
    return FetchSim("joint_target", boxes, statics, kind=kind)


def move(sim, steps, command, by=0.0):
    """Moves all joints by some radians a step; returns the impulses on the robot [N s]."""
    impulse = 0.0
    for _ in range(steps):
        target = sim.controller.arm_target_rad[0].numpy() + by
        impulse += sim.act(np.append(target, 1.0), command)
    return impulse


def groups(sim):
    """The collision groups of the first box."""
    return tuple(sim.objects[0]._bodies[0].collision_shapes[0].get_collision_groups()[:2])


@every_kind
def test_the_nearest_centre_of_mass_wins_over_a_nearer_surface(kind):
    # Box 0: centre at 0.14, its surface at 0.04. Box 1: centre at 0.12, its surface at 0.11.
    sim = sim_of(kind, [((0.1, 0.02, 0.02), (0.14, 0.0, 0.0)), ((0.01,) * 3, (0.0, 0.12, 0.0))])
    sim.grasp.command(GRASP)
    assert sim.grasp.held.tolist() == [1]


@every_kind
def test_the_grasp_ends_at_15_cm(kind):
    for distance, held in ((0.149, 0), (0.151, NOTHING)):
        sim = sim_of(kind, [(SMALL, (0.0, distance, 0.0))])
        assert np.allclose(sim.grasp.ee_position_m()[0], HAND_M, atol=1e-4)
        sim.grasp.command(GRASP)
        assert sim.grasp.held.tolist() == [held], distance
        assert sim.grasp.held_handle.tolist() == [NOTHING], distance


@every_kind
def test_zero_and_more_grasps(kind):
    sim = sim_of(kind, [(SMALL, (0.0, 0.0, -0.1))])
    for gripper, holds in ((0.0, True), (-0.01, False), (1.0, True)):
        sim.grasp.command(torch.tensor([gripper]))
        assert bool(sim.grasp.holding) == holds, gripper


@every_kind
def test_a_held_object_keeps_its_place_in_the_hand(kind):
    sim = sim_of(kind, [((0.03, 0.04, 0.05), (0.03, 0.02, -0.1))])
    sim.grasp.command(GRASP)
    start, before = sim.in_hand(), sim.objects[0].pose.p[0].clone()
    for phase in range(8):
        move(sim, 5, GRASP, SWING * np.cos(phase))
        now = sim.in_hand()
        assert np.linalg.norm(now[:3] - start[:3]) < KINDS[kind]
        # |q . q'| = cos(angle / 2); 0.0002 is 2.3 degrees
        assert abs(now[3:] @ start[3:]) > 1 - 2e-4
    assert np.linalg.norm(sim.objects[0].pose.p[0] - before) > 0.05, "the arm hardly moved"


@every_kind
def test_only_an_object_that_is_not_held_pushes_the_robot(kind):
    # The box reaches into the gripper: it is pushed out if the two meet.
    sim = sim_of(kind, [((0.1, 0.1, 0.1), (0.0, 0.0, 0.0))])
    sim.grasp.command(GRASP)
    assert groups(sim) == HELD
    assert move(sim, 10, GRASP, SWING) == 0.0
    assert sim.grasp.held.tolist() == [0]
    sim = sim_of(kind, [((0.1, 0.1, 0.1), (0.0, 0.0, 0.0))])
    assert groups(sim) == MOVING
    assert move(sim, 3, RELEASE) > 0.0


@every_kind
def test_a_held_object_meets_the_world(kind):
    # A wall 1 cm beside the box; the shoulder turns the arm towards it.
    sim = sim_of(
        kind,
        [((0.05, 0.05, 0.05), (0.0, 0.0, -0.12))],
        statics=[((0.3, 0.05, 0.3), (0.0, 0.11, -0.3))],
    )
    sim.grasp.command(GRASP)
    touched = False
    for _ in range(10):
        move(sim, 1, GRASP, SHOULDER)
        contacts = sim.scene.px.get_contacts()
        box = sim.objects[0]._bodies[0]
        touched |= any(
            box in c.bodies and any(np.linalg.norm(p.impulse) > 0 for p in c.points)
            for c in contacts
        )
    assert touched


@every_kind
def test_collisions_come_back_once_the_object_is_clear_of_the_hand(kind):
    sim = sim_of(kind, [(SMALL, (0.0, 0.0, -0.03))])
    sim.grasp.command(GRASP)
    move(sim, 2, GRASP)
    move(sim, 1, RELEASE)
    assert sim.grasp.held.tolist() == [NOTHING]
    assert groups(sim) == HELD, "it still lies in the hand"
    sim.objects[0].set_pose(sapien.Pose(HAND_M - [0, 0, 0.3]))
    move(sim, 1, RELEASE)
    assert groups(sim) == MOVING


@every_kind
def test_a_released_object_falls(kind):
    sim = sim_of(kind, [(SMALL, (0.0, 0.0, -0.1))])
    sim.objects[0]._bodies[0].disable_gravity = False
    move(sim, 5, GRASP)
    height = float(sim.objects[0].pose.p[0, 2])
    assert height == pytest.approx(HAND_M[2] - 0.1, abs=0.01)
    move(sim, 6, RELEASE)
    # 6 actions are 0.2 s: 9.81 / 2 * 0.2^2 = 0.196 m
    assert float(sim.objects[0].pose.p[0, 2]) == pytest.approx(height - 0.196, abs=0.03)


@every_kind
def test_what_is_pulled_out_of_the_hand_is_lost(kind):
    sim = sim_of(kind, [(SMALL, (0.0, 0.0, -0.1))])
    sim.grasp.command(GRASP)
    for distance, lost in ((0.08, False), (0.1, True)):
        expected = (sim.agent.ee_link.pose * sim.grasp._ee_from_object).p[0].numpy()
        sim.objects[0].set_pose(sapien.Pose(np.add(expected, (0, distance, 0))))
        sim.grasp.after_control_step()
        assert sim.grasp.lost.tolist() == [lost]
    assert sim.grasp.held.tolist() == [NOTHING]
    sim.grasp.command(RELEASE)
    assert sim.grasp.lost.tolist() == [False]


@every_kind
def test_reset_lets_go_and_restores_collisions_at_once(kind):
    sim = sim_of(kind, [(SMALL, (0.0, 0.0, -0.05))])
    sim.grasp.command(GRASP)
    sim.grasp.reset(torch.zeros(1, dtype=torch.long))
    assert not sim.grasp.holding
    assert groups(sim) == MOVING
    assert not sim.grasp.lost


# Handles ---------------------------------------------------------------------------------------


@every_kind
@drawer_and_door
def test_a_held_handle_opens_drawer_and_door(kind, marker):
    kitchen = Kitchen(kind, marker)
    before = kitchen.position()
    kitchen.grasp.command(GRASP)
    assert kitchen.grasp.held_handle.tolist() == [0]
    assert kitchen.grasp.held.tolist() == [NOTHING]
    # Pull in the direction in which the marker moves when the joint opens.
    direction = opening_direction(kitchen)
    base = kitchen.agent.robot._objs[0]
    for _ in range(60):
        kitchen.grasp.command(GRASP)
        for _ in range(4):
            qpos = base.get_qpos()
            qpos[kitchen.agent.base_index.tolist()[:2]] += 0.002 * direction
            base.set_qpos(qpos)
            kitchen.grasp.before_simulation_step()
            kitchen.scene.px.step()
    opened = kitchen.position() - before
    # 60 * 4 * 2 mm is 0.48 m of way; a drawer has half of that, a door opens by more than 0.3 rad.
    assert opened > 0.15, opened
    kitchen.grasp.command(RELEASE)
    assert not kitchen.grasp.holding


@every_kind
def test_a_hand_takes_what_its_skill_is_about_and_objects_before_handles(kind):
    kitchen = Kitchen(kind, DRAWER)
    hand = kitchen.grasp.ee_position_m()[0].numpy()  # on the marker
    box = box_actor(kitchen.scene, "late", SMALL, tuple(np.add(hand, (0, 0, 0.12))))
    near, far = box.pose, sapien.Pose([0.0, 0.0, 30.0])
    for takes, held, handle, alone in (
        ("any", 0, NOTHING, 0),
        ("objects", 0, NOTHING, NOTHING),
        ("handles", NOTHING, 0, 0),
    ):
        both = kind(kitchen.scene, kitchen.agent.ee_link, [box], [kitchen.handle], takes)
        both.command(GRASP)
        assert (both.held.tolist(), both.held_handle.tolist()) == ([held], [handle]), takes
        both.command(RELEASE)
        box.set_pose(far)
        both.command(GRASP)
        assert both.held_handle.tolist() == [alone], takes
        both.command(RELEASE)
        box.set_pose(near)


@every_kind
def test_what_is_shut_in_is_not_grasped(kind):
    offsets = ((0.0, 0.0, -0.05), (0.0, 0.1, 0.0))
    sim = sim_of(kind, [(SMALL, offset) for offset in offsets])
    sim.grasp.is_enclosed = lambda: torch.tensor([[True, False]])
    sim.grasp.command(GRASP)
    assert sim.grasp.held.tolist() == [1]
    sim.grasp.command(RELEASE)
    sim.grasp.is_enclosed = lambda: torch.tensor([[True, True]])
    sim.grasp.command(GRASP)
    assert not sim.grasp.holding
    sim.grasp.is_enclosed = lambda: None
    sim.grasp.command(GRASP)
    assert sim.grasp.held.tolist() == [0]


def test_every_marker_names_furniture_of_the_apartment():
    dataset = resolve_dataset("apartment")
    spec = load_scene(dataset, sorted(dataset.scene_files)[0])
    assert {m.template for m in HANDLE_MARKERS} <= {*dataset.urdf_files}
    here = {a.template for a in spec.articulations}
    assert {m.name for m in HANDLE_MARKERS if m.template in here} == {
        m.name for m in HANDLE_MARKERS
    }


# Arms that are set at once ---------------------------------------------------------------------

PULLING = partial(DriveGrasp, pulls_along=True)


@drawer_and_door
def test_a_door_or_drawer_follows_a_hand_that_is_set(marker):
    kitchen = Kitchen(PULLING, marker)
    before, direction = kitchen.position(), opening_direction(kitchen)
    robot = kitchen.agent.robot._objs[0]
    columns = kitchen.agent.base_index.tolist()[:2]
    kitchen.grasp.command(GRASP)
    for _ in range(12):
        qpos = robot.get_qpos()
        qpos[columns] += 0.02 * direction
        robot.set_qpos(qpos)
        robot.set_qvel(np.zeros_like(qpos))
        kitchen.act()
        # The hand goes straight on; the door's handle goes round its hinge.
        assert kitchen.gap_m() < (5e-3 if marker is DRAWER else 0.06)
    assert np.allclose(robot.get_qpos(), qpos, atol=1e-4), "the hand is where it was set"
    # 24 cm: all of a drawer's way, or 0.3 rad and more about a hinge less than 0.8 m away.
    assert kitchen.position() - before > (0.23 if marker is DRAWER else 0.3)
    for _ in range(2):
        kitchen.act()
    assert float(kitchen.furniture.get_qvel().abs().max()) < 0.02
    assert kitchen.grasp.held_handle.tolist() == [0]


@every_kind
def test_a_hand_that_is_set_far_away_lets_go_of_a_handle(kind):
    kitchen = Kitchen(kind, DRAWER)
    before = kitchen.position()
    kitchen.grasp.command(GRASP)
    robot = kitchen.agent.robot._objs[0]
    qpos = robot.get_qpos()
    qpos[kitchen.agent.base_index.tolist()[0]] -= 2.0
    robot.set_qpos(qpos)
    kitchen.act()
    assert not kitchen.grasp.holding
    assert kitchen.position() == pytest.approx(before, abs=1e-3)
