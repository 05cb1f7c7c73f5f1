"""SPA-Priv at the fridge: door geometry, and maneuvers of the base."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hab_spa.skills.fridge.config import ExitConfig, FridgeConfig, pull_of, wider
from hab_spa.skills.fridge.door import Door
from hab_spa.skills.fridge.maneuver import base_maneuvers

from hab_tasks.privileged import ArticulationState
from hab_tasks.robots.fetch import FETCH
from hab_tasks.world.navigation import NavigationMap
from hab_tasks.world.scenes.floor import floor_between


def door_at(joint: float) -> ArticulationState:
    """Hinge at the origin, frame along the world's axes, closed along +y; opens clockwise."""
    turn = np.array(((np.cos(joint), np.sin(joint)), (-np.sin(joint), np.cos(joint))))
    handle = turn @ (0.1, 0.6)
    return ArticulationState(
        kind="fridge",
        body="fridge/door",
        handle_m=np.append(handle, 1.2),
        held=False,
        joint=joint,
        limits=(0.0, 2.3),
        slides=False,
        axis=np.array((0.0, 0.0, -1.0)),
        axis_point_m=np.array((0.0, 0.0, 1.4)),
        frame=np.zeros(3),
    )


def test_door_is_the_same_however_far_it_is_open():
    for joint in (0.0, 0.7):
        door = Door(door_at(joint))
        np.testing.assert_allclose(door.handle_m, (0.6, 0.1), atol=1e-9)
        np.testing.assert_allclose(door.handle(0.0), (0.1, 0.6, 1.2), atol=1e-9)
        # A quarter turn clockwise takes +y to +x and +x to -y.
        np.testing.assert_allclose(door.handle(math.pi / 2), (0.6, -0.1, 1.2), atol=1e-9)
        np.testing.assert_allclose(door.beside(np.array((0.6, -0.1)), math.pi / 2), (0.6, 0.1))


def test_gap_to_the_door():
    door = Door(door_at(1.0))
    # The handle is 0.1 off the hinge's plane, and 0.04 off the face; the edge is at 0.68.
    points = np.array(((0.1, 0.6), (0.03, 0.3), (0.06, 0.78), (0.36, 0.3)))
    np.testing.assert_allclose(door.gap_m(points, 0.0), (0.04, 0.0, 0.1, 0.3), atol=1e-9)
    # Opened by 90 degrees the door lies along +x, with its outer face at y = -0.06.
    np.testing.assert_allclose(door.gap_m(np.array((0.5, -0.16)), math.pi / 2), 0.1, atol=1e-9)


def test_a_pull_tells_when_the_door_is_far_enough():
    config = FridgeConfig(open_need=0.6, opened=1.6, close_need=0.45, closed=0.1, close_to=0.05)
    opening = pull_of(door_at(0.0), True, config)
    closing = pull_of(door_at(1.5), False, config)
    assert [opening.is_sufficient(joint) for joint in (0.59, 0.61)] == [False, True]
    assert [opening.is_complete(joint) for joint in (1.59, 1.61)] == [False, True]
    assert [closing.is_sufficient(joint) for joint in (1.06, 1.04)] == [False, True]
    assert [closing.is_complete(joint) for joint in (0.11, 0.09)] == [False, True]
    np.testing.assert_allclose(closing.swept, (0.05, 1.5))
    # From 1.0 rad a way to 1.25 rad will do; from 1.5 rad it has to go all the way.
    config = FridgeConfig(open_need=0.6, open_more=0.25, opened=1.6)
    needs = [pull_of(door_at(joint), True, config).need for joint in (1.0, 1.5)]
    assert needs == pytest.approx([1.25, 1.6])


def test_a_door_opens_until_the_fridge_can_be_reached():
    def floor_map(joints=None):
        """Of a corner: a wall along x = 1.2 m, which the door at the origin narrows."""
        joint = (joints or {0: math.pi / 2})[0]
        out, aside = np.array((math.sin(joint), math.cos(joint))), np.array((0.02, 0.02))
        door = np.array((-aside, aside, 0.68 * out + aside, 0.68 * out - aside))
        wall = np.array(((1.2, -1.0), (1.4, -1.0), (1.4, 0.6), (1.2, 0.6)))
        floor = floor_between([door, wall], np.array(((0.0, -1.0), (3.0, 3.0))), radius_m=0.3)
        return NavigationMap(floor, np.zeros_like(floor.room))

    def robot_at(joint):
        door = replace(door_at(joint), frame=np.array((-0.1, -0.4, 0.0)))
        scene = SimpleNamespace(articulation=lambda _: door, floor_map=floor_map)
        return SimpleNamespace(scene=scene, base=np.array((1.0, 2.0, 0.0)))

    # The base needs 0.6 m between the door's edge, at 0.68 m * sin(joint), and the wall: 2.06 rad.
    config = wider(robot_at(math.pi / 2), 0, FridgeConfig(), ExitConfig())
    assert config is not None
    assert 2.0 < config.opened < 2.25


def test_shunts_end_at_the_goal_in_every_way():
    base, goal = np.array((1.0, 0.0, 0.0)), np.array((0.0, 0.0, math.pi / 2))
    found = base_maneuvers(FETCH, base, goal)
    assert len(found) == 8
    for maneuver in found:
        end = maneuver.poses()[-1]
        np.testing.assert_allclose(end[:2], goal[:2], atol=1e-9)
        assert math.isclose(math.remainder(end[2] - goal[2], math.tau), 0.0, abs_tol=1e-9)
    # The quickest goes one metre back and turns left by a quarter.
    assert found[0].length_m == pytest.approx(-1.0)
    turn_steps = math.pi / 2 / FETCH.base_step_rad
    assert found[0].steps == pytest.approx(1.0 / FETCH.base_step_m + turn_steps + 12.0)
