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
from hab_tasks.robots.control_modes import ABSOLUTE_ARM, BASE_CELLS, STOP_CELL, STOP_SHARE
from hab_tasks.robots.robot import ROBOT

MODES = tuple(control_configs())
SIZES = {
    "ee": 4,
    "ee_base": 6,
    "joint_delta": 8,
    "joint_delta_base": 10,
    "joint_target": 8,
    "joint_target_base": 10,
    "joint_target_pose": 11,
    "joint_state": 8,
    "joint_state_base": 10,
    "joint_state_pose": 11,
    "base": 2,
}
"""Mode -> number of entries of an action; those of a pose are tested with the modes that set."""


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
    return world_to_base(torch.from_numpy(sim.base())[None], point[None])[0].numpy()


def stopped(sim):
    return bool(sim.controller.stopped[0])


def test_the_cells_are_the_papers():
    """Linear -0.5 to 1 in 4, angular -1 to 1 in 5, giving 20 cells (H.2)."""
    linear = np.linspace(-0.5, 1.0, 4)
    angular = np.linspace(-1.0, 1.0, 5)
    assert len(BASE_CELLS) == 20
    assert set(BASE_CELLS) == {(x, y) for x in linear.tolist() for y in angular.tolist()}
    assert BASE_CELLS[STOP_CELL] == (0.0, 0.0)
    assert BASE_CELLS.count((0.0, 0.0)) == 1


def test_action_spaces():
    assert set(MODES) == {*SIZES, "base_discrete"}
    assert FetchSim("base_discrete").controller.single_action_space == spaces.Discrete(20)
    for mode, size in SIZES.items():
        space = FetchSim(mode).controller.single_action_space
        assert space.shape == (size,), mode
        arm = 0 if mode == "base" else 7 if mode.startswith("joint") else 3
        low, high = (-1,) * arm, (1,) * arm
        if mode.startswith(ABSOLUTE_ARM):
            low, high = ROBOT.arm_lower_rad, ROBOT.arm_upper_rad
        known = slice(0, size - 3 if mode.endswith("pose") else size)
        assert np.allclose(space.low[known], [*low, *[-1] * (size - arm)][known]), mode
        assert np.allclose(space.high[known], [*high, *[1] * (size - arm)][known]), mode


# Driving ---------------------------------------------------------------------------------------


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


def test_turning_in_place():
    sim = FetchSim("base")
    sim.act([0.0, 0.5], steps=15)
    x, y, heading = sim.base()
    # Half a second at 1.57 rad/s.
    assert heading == pytest.approx(0.785, abs=0.08)
    assert math.hypot(x, y) < 0.01


def test_a_cell_is_the_same_as_its_velocities():
    for cell in (0, STOP_CELL, 12, 19):
        by_cell, by_velocity = turned("base_discrete", 0.7), turned("base", 0.7)
        by_cell.act([cell], steps=10)
        by_velocity.act(BASE_CELLS[cell], steps=10)
        assert np.array_equal(by_cell.base(), by_velocity.base()), cell
        moved = np.abs(by_cell.base() - [0, 0, 0.7]).max()
        assert moved < 1e-4 if cell == STOP_CELL else moved > 0.05, cell


def test_the_arm_stays_at_rest_while_the_base_drives():
    sim = FetchSim("base")
    for action in ([1.0, 0.0], [1.0, 0.7], [-1.0, -1.0], [0.0, 0.0]):
        sim.act(action, steps=10)
        assert np.linalg.norm(hand_m(sim) - REST_POSITION_M) < 0.05


def test_velocities_beyond_the_largest_are_clipped():
    fast, fastest = FetchSim("base"), FetchSim("base")
    fast.act([5.0, -7.0], steps=10)
    fastest.act([1.0, -1.0], steps=10)
    assert np.array_equal(fast.base(), fastest.base())


# Stopping --------------------------------------------------------------------------------------


def test_both_velocities_next_to_zero_is_the_stop_action():
    assert STOP_SHARE == 0.05
    sim = FetchSim("base")
    for linear, angular, stops in (
        (0.0, 0.0, True),
        (0.049, -0.049, True),
        (0.051, 0.0, False),
        (0.0, -0.051, False),
        (-1.0, 1.0, False),
    ):
        sim.act([linear, angular])
        assert stopped(sim) == stops, (linear, angular)


def test_only_one_cell_stops_and_no_mode_without_base():
    sim = FetchSim("base_discrete")
    for cell in range(len(BASE_CELLS)):
        sim.act([cell])
        assert stopped(sim) == (cell == STOP_CELL), cell
    sim = FetchSim("ee")
    sim.act([0.0, 0.0, 0.0, -1.0])
    assert not stopped(sim)


def test_what_is_no_cell_is_refused():
    sim = FetchSim("base_discrete")
    for cell in (-1.0, 20.0, 0.5, math.nan, math.inf):
        with pytest.raises(ActionError, match=r"cells are 0 to 19"):
            sim.act([cell])
        assert not stopped(sim), cell
    for shape in ((2,), (1, 2), (0,), (1, 1, 1)):
        with pytest.raises(ActionError, match=r"expected \(1,\)"):
            sim.controller.set_action(torch.full(shape, float(STOP_CELL)))


# Doing nothing ---------------------------------------------------------------------------------


def test_the_idle_action_moves_nothing_and_keeps_what_is_held():
    for mode in MODES:
        sim = FetchSim(mode)
        hand, base = hand_m(sim), sim.base()
        for holding in (True, False):
            action = sim.idle(holding=holding)
            sim.act(action, steps=15)
            space = sim.controller.single_action_space
            value = int(action[0]) if isinstance(space, spaces.Discrete) else action
            assert space.contains(value), mode
            if not mode.startswith("base"):
                assert bool(sim.controller.gripper[0] >= 0) == holding, mode
        assert np.linalg.norm(hand_m(sim) - hand) < 1e-3, mode
        assert np.abs(sim.base() - base).max() < 1e-4, mode
        assert stopped(sim) == ("base" in mode), mode


def test_the_idle_action_of_a_batch():
    action = FetchSim("ee_base").controller.idle_action(torch.tensor([True, False, True]))
    assert action.tolist() == [[0, 0, 0, 1, 0, 0], [0, 0, 0, -1, 0, 0], [0, 0, 0, 1, 0, 0]]
    cells = FetchSim("base_discrete").controller.idle_action(torch.tensor([True, False]))
    assert cells.tolist() == [[STOP_CELL], [STOP_CELL]]
