"""Fingers hold by contact what they can span, and nothing else; their grip is no collision."""

import pytest
from fetch_sim import GRASP, RELEASE, FetchSim

from hab_tasks.engine.snapshot import ContactForce
from hab_tasks.episodes.spanning import spanned
from hab_tasks.errors import GenerationError
from hab_tasks.object_names import TRAIN_OBJECTS
from hab_tasks.robots.fetch import FETCH, FETCH_FRICTION
from hab_tasks.robots.fetch.agent import HabFetchFriction
from hab_tasks.robots.grasp import NOTHING
from hab_tasks.simulator import rigid_body
from hab_tasks.world.scenes.objects import load_objects

THIN, THICK = (0.015, 0.02, 0.02), (0.015, 0.06, 0.02)
UP, ASIDE = (0, 0, 1), (0, 1, 0)


def sim_with(half, offset=(0.0, 0.0, 0.0)):
    return FetchSim("ee", [(half, offset)], robot=HabFetchFriction)


def closed(sim):
    """Closes the hand; then gravity pulls at the object."""
    sim.act(sim.idle(), GRASP, steps=20)
    rigid_body(sim.objects[0]).disable_gravity = False
    return sim


def height_m(sim):
    return float(sim.objects[0].pose.p[0, 2])


def test_what_both_fingers_press_on_is_held_and_carried():
    sim = sim_with(THIN)
    assert not sim.grasp.holding
    closed(sim)
    assert sim.grasp.held == 0
    # The box is 4 cm wide; both joints together are the gap between the fingers.
    fingers = [sim.agent.joint_index[name] for name in FETCH_FRICTION.finger_joints]
    assert float(sim.agent.robot.get_qpos()[0, fingers].sum()) == pytest.approx(0.04, abs=4e-3)
    before, in_hand = height_m(sim), sim.in_hand()
    sim.act((*UP, GRASP), GRASP, steps=10)
    sim.act((*ASIDE, GRASP), GRASP, steps=10)
    assert height_m(sim) - before > 0.1
    assert sim.in_hand() == pytest.approx(in_hand, abs=0.01)
    assert (sim.grasp.held, sim.grasp.lost) == (0, False)
    sim.act(sim.idle(), RELEASE, steps=20)
    assert sim.grasp.held == NOTHING
    assert not sim.grasp.lost  # let go on purpose
    assert height_m(sim) < 0.1


def test_nothing_beside_the_fingers_or_wider_than_they_open_is_held():
    # Within the radius of the snap grasp, 15 cm.
    for half, offset in ((THIN, (0.0, 0.0, -0.12)), (THICK, (0.0, 0.0, -0.06))):
        sim = closed(sim_with(half, offset))
        sim.act(sim.idle(), GRASP, steps=5)
        assert sim.grasp.held == NOTHING


def test_what_is_pulled_out_is_lost():
    sim = closed(sim_with(THIN))
    body = rigid_body(sim.objects[0])
    # Two fingers with friction 2 and at most 100 N each hold less than 400 N.
    for _ in range(3):
        for _ in range(4):
            body.add_force_at_point([0.0, 0.0, -600.0], body.entity_pose.p)
        sim.act(sim.idle(), GRASP)
        if sim.grasp.lost:
            break
    assert sim.grasp.held == NOTHING


def test_the_grip_is_no_contact_force():
    sim = sim_with(THIN)
    force = ContactForce(sim.agent)
    closed(sim)
    force.clear()
    sim.scene.px.step()
    force.add_physics_step()
    assert force.newton() == 0.0
    assert min(sim.grasp._pressed_n()[rigid_body(sim.objects[0])]) > 10.0
    # The palm on a box is one.
    pressed = FetchSim("ee", [], [((0.1, 0.1, 0.1), (0.0, 0.0, -0.12))], robot=HabFetchFriction)
    assert pressed.act((0, 0, -1, RELEASE), steps=10) > 0.0


def test_a_state_is_restored():
    sim = closed(sim_with(THIN))
    state = sim.grasp.get_state()
    sim.act(sim.idle(), RELEASE, steps=3)
    sim.grasp.set_state(state)
    assert sim.grasp.get_state() == state
    assert sim.grasp.awake_in(state) == [0]


def test_only_objects_that_fit_are_drawn():
    templates = load_objects(None)
    # The coffee can is 10.2 cm wide and 13.9 cm high; the hand spans 9.2 cm.
    assert set(TRAIN_OBJECTS) - set(spanned(TRAIN_OBJECTS, templates, FETCH_FRICTION)) == {
        "002_master_chef_can"
    }
    assert spanned(TRAIN_OBJECTS, templates, FETCH) == TRAIN_OBJECTS
    with pytest.raises(GenerationError, match=r"spans 0\.092 m, and no object: .*0\.102 m"):
        spanned(("002_master_chef_can",), templates, FETCH_FRICTION)
