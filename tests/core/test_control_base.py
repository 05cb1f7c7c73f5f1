"""Actions of the base: cells, velocities, stop and no-op."""

import math

import numpy as np
import pytest
import torch
from builders import cpu_scene, start_fetch
from gymnasium import spaces

from hab_tasks.constants import REST_POSITION_M
from hab_tasks.engine.snapshot import world_to_base
from hab_tasks.errors import ActionError
from hab_tasks.robots.control import control_configs
from hab_tasks.robots.control_modes import ABSOLUTE_ARM, BASE_CELLS, STOP_CELL, STOP_SHARE
from hab_tasks.robots.fetch import HabFetch
from hab_tasks.robots.robot import ROBOT

MODES = tuple(control_configs())
MOBILE = tuple(mode for mode in MODES if "base" in mode)
HOLDING, EMPTY = torch.ones(1, dtype=torch.bool), torch.zeros(1, dtype=torch.bool)


class RobotSim:
    """The robot at rest on an endless plane without anything on it."""

    def __init__(self, mode, yaw=0.0):
        self.scene = cpu_scene()
        self.agent = HabFetch(self.scene, 30, mode)
        self.scene._setup(enable_gpu=False)
        start_fetch(self.agent)
        qpos = self.agent.robot.get_qpos()
        qpos[0, self.agent.base_index[2]] = yaw
        self.agent.robot.set_qpos(qpos)
        self.agent.controller.reset()

    def act(self, action, steps=1):
        for _ in range(steps):
            value = torch.as_tensor(np.array(action), dtype=torch.float32)
            self.agent.controller.set_action(value.reshape(1, -1))
            for _ in range(4):
                self.scene.px.step()

    def base(self):
        return self.agent.robot.get_qpos()[0, self.agent.base_index].numpy()

    def hand(self):
        """The end-effector in the base frame."""
        point = (self.agent.ee_link.pose.to_transformation_matrix()[0] @ self.offset)[:3]
        return world_to_base(torch.from_numpy(self.base())[None], point[None])[0].numpy()

    offset = torch.tensor([0.08, 0.0, 0.0, 1.0])

    @property
    def stopped(self):
        return bool(self.agent.controller.stopped[0])

    def idle(self, holding=EMPTY):
        return self.agent.controller.idle_action(holding)[0].numpy()


# Cells and spaces ------------------------------------------------------------------------------


def test_the_cells_are_the_papers():
    """Linear -0.5 to 1 in 4, angular -1 to 1 in 5, giving 20 cells (H.2)."""
    linear = np.linspace(-0.5, 1.0, 4)
    angular = np.linspace(-1.0, 1.0, 5)
    assert len(BASE_CELLS) == 20
    assert set(BASE_CELLS) == {(x, y) for x in linear.tolist() for y in angular.tolist()}
    assert BASE_CELLS[STOP_CELL] == (0.0, 0.0)
    assert BASE_CELLS.count((0.0, 0.0)) == 1


@pytest.mark.parametrize(
    ("mode", "size"),
    [
        ("ee", 4),
        ("ee_base", 6),
        ("joint_delta", 8),
        ("joint_delta_base", 10),
        ("joint_target", 8),
        ("joint_target_base", 10),
        ("joint_state", 8),
        ("joint_state_base", 10),
        ("base", 2),
    ],
)
def test_action_spaces(mode, size):
    space = RobotSim(mode).agent.controller.single_action_space
    assert space.shape == (size,)
    arm = size - 1 - 2 * mode.endswith("base") if mode != "base" else 0
    low, high = (
        (ROBOT.arm_lower_rad, ROBOT.arm_upper_rad)
        if mode.startswith(ABSOLUTE_ARM)
        else ((-1,) * arm, (1,) * arm)
    )
    assert np.allclose(space.low, [*low, *[-1] * (size - arm)])
    assert np.allclose(space.high, [*high, *[1] * (size - arm)])


def test_the_cells_action_space():
    assert RobotSim("base_discrete").agent.controller.single_action_space == spaces.Discrete(20)


def test_all_modes_are_known():
    assert set(MODES) == {
        *(
            f"{arm}{base}"
            for arm in ("ee", "joint_delta", "joint_target", "joint_state")
            for base in ("", "_base")
        ),
        "joint_target_pose",
        "joint_state_pose",
        "base",
        "base_discrete",
    }


# Driving ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_forwards_is_where_the_base_looks(yaw):
    sim = RobotSim("base", yaw)
    sim.act([1.0, 0.0], 30)
    x, y, turned = sim.base()
    # One second at 1 m/s, less what it takes to come up to speed.
    assert math.hypot(x, y) == pytest.approx(1.0, abs=0.05)
    assert math.atan2(y, x) == pytest.approx(yaw, abs=0.02)
    assert turned == pytest.approx(yaw, abs=0.02)
    sim.act([-0.5, 0.0], 30)
    assert math.hypot(*sim.base()[:2]) == pytest.approx(0.5, abs=0.08)


def test_turning_in_place():
    sim = RobotSim("base")
    sim.act([0.0, 0.5], 15)
    x, y, turned = sim.base()
    # Half a second at 1.57 rad/s.
    assert turned == pytest.approx(0.785, abs=0.08)
    assert math.hypot(x, y) < 0.01


@pytest.mark.parametrize("cell", [0, STOP_CELL, 12, 19])
def test_a_cell_is_the_same_as_its_velocities(cell):
    by_cell, by_velocity = RobotSim("base_discrete", 0.7), RobotSim("base", 0.7)
    by_cell.act([cell], 10)
    by_velocity.act(BASE_CELLS[cell], 10)
    assert np.array_equal(by_cell.base(), by_velocity.base())
    moved = np.abs(by_cell.base() - [0, 0, 0.7]).max()
    assert moved < 1e-4 if cell == STOP_CELL else moved > 0.05


def test_the_arm_stays_at_rest_while_the_base_drives():
    sim = RobotSim("base")
    for action in ([1.0, 0.0], [1.0, 0.7], [-1.0, -1.0], [0.0, 0.0]):
        sim.act(action, 10)
        assert np.linalg.norm(sim.hand() - REST_POSITION_M) < 0.05


def test_velocities_beyond_the_largest_are_clipped():
    fast, fastest = RobotSim("base"), RobotSim("base")
    fast.act([5.0, -7.0], 10)
    fastest.act([1.0, -1.0], 10)
    assert np.array_equal(fast.base(), fastest.base())


# Stopping --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("linear", "angular", "stopped"),
    [
        (0.0, 0.0, True),
        (0.049, -0.049, True),
        (0.051, 0.0, False),
        (0.0, -0.051, False),
        (-1.0, 1.0, False),
    ],
)
def test_both_velocities_next_to_zero_is_the_stop_action(linear, angular, stopped):
    assert STOP_SHARE == 0.05
    sim = RobotSim("base")
    sim.act([linear, angular])
    assert sim.stopped == stopped


def test_only_one_cell_stops():
    sim = RobotSim("base_discrete")
    for cell in range(len(BASE_CELLS)):
        sim.act([cell])
        assert sim.stopped == (cell == STOP_CELL), cell


def test_a_mode_without_base_never_stops():
    sim = RobotSim("ee")
    sim.act([0.0, 0.0, 0.0, -1.0])
    assert not sim.stopped


@pytest.mark.parametrize("cell", [-1.0, 20.0, 0.5, math.nan, math.inf])
def test_what_is_no_cell_is_refused(cell):
    sim = RobotSim("base_discrete")
    with pytest.raises(ActionError, match=r"cells are 0 to 19"):
        sim.act([cell])
    assert not sim.stopped


@pytest.mark.parametrize("shape", [(2,), (1, 2), (0,), (1, 1, 1)])
def test_a_wrong_number_of_cells_is_refused(shape):
    sim = RobotSim("base_discrete")
    with pytest.raises(ActionError, match=r"expected \(1,\)"):
        sim.agent.controller.set_action(torch.full(shape, float(STOP_CELL)))


# Doing nothing ---------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", MODES)
def test_the_idle_action_moves_nothing(mode):
    sim = RobotSim(mode)
    hand, base = sim.hand(), sim.base()
    for holding in (EMPTY, HOLDING):
        action = sim.idle(holding)
        sim.act(action, 15)
        space = sim.agent.controller.single_action_space
        value = int(action[0]) if isinstance(space, spaces.Discrete) else action
        assert space.contains(value)
    assert np.linalg.norm(sim.hand() - hand) < 1e-3
    assert np.abs(sim.base() - base).max() < 1e-4
    assert sim.stopped == (mode in MOBILE)


@pytest.mark.parametrize("mode", [mode for mode in MODES if not mode.startswith("base")])
def test_the_idle_action_keeps_what_is_held_and_takes_nothing(mode):
    sim = RobotSim(mode)
    for holding in (HOLDING, EMPTY):
        sim.act(sim.idle(holding))
        assert bool(sim.agent.controller.gripper[0] >= 0) == bool(holding[0])


def test_the_idle_action_of_a_batch():
    sim = RobotSim("ee_base")
    action = sim.agent.controller.idle_action(torch.tensor([True, False, True]))
    assert action.tolist() == [[0, 0, 0, 1, 0, 0], [0, 0, 0, -1, 0, 0], [0, 0, 0, 1, 0, 0]]
    cells = RobotSim("base_discrete").agent.controller.idle_action(torch.tensor([True, False]))
    assert cells.tolist() == [[STOP_CELL], [STOP_CELL]]
