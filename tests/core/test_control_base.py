"""Actions of the base: cells, velocities, stop and no-op."""

import math

import numpy as np
import pytest
import torch
from fetch_sim import FetchSim
from gymnasium import spaces

from hab_tasks.constants import REST_POSITION_M
from hab_tasks.engine.snapshot import world_to_base
from hab_tasks.errors import ActionError
from hab_tasks.robots.control import control_configs
from hab_tasks.robots.control_modes import BASE_CELLS, STOP_CELL
from hab_tasks.robots.fetch import FETCH


def turned(mode, yaw):
    """The robot at the origin with another heading [rad]."""
    sim = FetchSim(mode)
    qpos = sim.agent.robot.get_qpos()
    qpos[0, sim.agent.base_index[2]] = yaw
    sim.agent.robot.set_qpos(qpos)
    sim.controller.reset()
    return sim


def hand_m(sim):
    """The end-effector (3,) in the base frame."""
    pose = sim.agent.ee_link.pose.to_transformation_matrix()[0]
    point = (pose @ torch.tensor([0.08, 0.0, 0.0, 1.0]))[:3]
    return world_to_base(sim.base()[None], point[None, None].numpy())[0, 0]


def test_the_cells_are_the_papers():
    """Linear -0.5 to 1 in 4, angular -1 to 1 in 5, giving 20 cells (H.2)."""
    linear, angular = (-0.5, 0.0, 0.5, 1.0), (-1.0, -0.5, 0.0, 0.5, 1.0)
    assert sorted(BASE_CELLS) == [(x, y) for x in linear for y in angular]
    assert BASE_CELLS[STOP_CELL] == (0.0, 0.0)


def test_action_spaces():
    arm = (FETCH.arm_lower_rad, FETCH.arm_upper_rad)
    for mode, (low, high), others in (
        ("ee_base", ((), ()), 6),
        ("joint_delta", ((), ()), 8),
        ("joint_target", arm, 1),
        ("joint_state_base", arm, 3),
    ):
        space = FetchSim(mode).controller.single_action_space
        assert np.allclose(space.low, [*low, *[-1] * others]), mode
        assert np.allclose(space.high, [*high, *[1] * others]), mode


def test_forwards_is_where_the_base_looks():
    for yaw in (0.0, 2.0):
        sim = turned("base", yaw)
        sim.act([1.0, 0.0], steps=30)
        x, y, heading = sim.base()
        # One second at 1 m/s, less what it takes to come up to speed.
        assert math.hypot(x, y) == pytest.approx(1.0, abs=0.05)
        assert math.atan2(y, x) == pytest.approx(yaw, abs=0.02)
        assert heading == pytest.approx(yaw, abs=0.02)
        sim.act([-0.5, 0.0], steps=30)
        assert math.hypot(*sim.base()[:2]) == pytest.approx(0.5, abs=0.08)
        assert np.linalg.norm(hand_m(sim) - REST_POSITION_M) < 0.05, "the arm stays at rest"


def test_a_cell_is_the_same_as_its_velocities():
    for cell in (0, STOP_CELL, 12, 19):
        by_cell, by_velocity = turned("base_discrete", 0.7), turned("base", 0.7)
        by_cell.act([cell], steps=10)
        by_velocity.act(BASE_CELLS[cell], steps=10)
        assert np.array_equal(by_cell.base(), by_velocity.base()), cell
        moved = np.abs(by_cell.base() - [0, 0, 0.7]).max()
        assert moved < 1e-4 if cell == STOP_CELL else moved > 0.05, cell


def test_both_velocities_next_to_zero_and_one_cell_stop():
    sims = {mode: FetchSim(mode) for mode in ("base", "base_discrete", "ee")}
    for mode, action, stops in (
        ("base", (0.0, 0.0), True),
        ("base", (0.049, -0.049), True),
        ("base", (0.051, 0.0), False),
        ("base", (0.0, -0.051), False),
        *(("base_discrete", (cell,), cell == STOP_CELL) for cell in range(len(BASE_CELLS))),
        ("ee", (0.0, 0.0, 0.0, -1.0), False),
    ):
        sims[mode].act(action)
        assert bool(sims[mode].controller.stopped) == stops, (mode, action)


def test_what_is_no_cell_is_refused():
    sim = FetchSim("base_discrete")
    for cell in (-1.0, 20.0, 0.5, math.nan, math.inf):
        with pytest.raises(ActionError, match=r"cells are 0 to 19"):
            sim.act([cell])
        assert not sim.controller.stopped, cell
    with pytest.raises(ActionError, match=r"expected \(1,\)"):
        sim.controller.set_action(torch.full((1, 2), float(STOP_CELL)))


def test_the_idle_action_moves_nothing_and_keeps_what_is_held():
    for mode in control_configs(FETCH):
        sim = FetchSim(mode)
        hand, base = hand_m(sim), sim.base()
        for holding in (True, False):
            action = sim.idle(holding=holding)
            sim.act(action, steps=15)
            space = sim.controller.single_action_space
            value = int(action[0]) if isinstance(space, spaces.Discrete) else action
            assert space.contains(value), mode
            if not mode.startswith("base"):
                assert (sim.controller.gripper >= 0) == holding, mode
        assert np.linalg.norm(hand_m(sim) - hand) < 1e-3, mode
        assert np.abs(sim.base() - base).max() < 1e-4, mode
        assert bool(sim.controller.stopped) == ("base" in mode), mode
