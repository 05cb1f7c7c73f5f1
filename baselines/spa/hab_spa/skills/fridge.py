"""Open fridge and Close fridge: the hand takes the handle and leads the door along its arc."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import replace

import numpy as np

from hab_spa.motion.moves import go, wait
from hab_spa.motion.rest import TUCKED_QPOS_RAD, draw_out, rest
from hab_spa.motion.robot import GRASP, RELEASE, Command, Motion, Robot
from hab_spa.planning.path import time_path
from hab_spa.results import Failure
from hab_spa.shapes import Array
from hab_spa.skills.fridge_arc import Lead
from hab_spa.skills.fridge_config import FridgeConfig, pull_of
from hab_spa.skills.fridge_place import Chosen, Places
from hab_spa.skills.fridge_shunt import drive
from hab_spa.skills.fridge_tow import rolling, with_base, without_base
from hab_tasks.episodes.robot_start import Rectangle
from hab_tasks.fronts import FRIDGE_CLOSED_RAD, FRIDGE_OPEN_RAD
from hab_tasks.navigation import NavigationMap

ALL_WAYS = 12
"""The most that `fridge_ways` returns."""


def open_fridge(
    robot: Robot, number: int, region: Rectangle | None = None, config: FridgeConfig | None = None
) -> Motion:
    """Opens the fridge by more than 90 degrees, and rests beside the door.

    Args:
        robot: Who does it.
        number: Number of the fridge among the doors and drawers of the episode.
        region: Rectangle in the fridge's frame that the base must not leave.
        config: The numbers.
    """
    return (yield from _Fridge(robot, number, True, region, config or FridgeConfig()).move())


def close_fridge(
    robot: Robot, number: int, region: Rectangle | None = None, config: FridgeConfig | None = None
) -> Motion:
    """Closes the fridge, and rests; see `open_fridge`."""
    return (yield from _Fridge(robot, number, False, region, config or FridgeConfig()).move())


def fridge_places(
    robot: Robot, number: int, map_: NavigationMap, out: bool, config: FridgeConfig | None = None
) -> Array:
    """Returns free base poses (K, 3) before a fridge, those first that do best at first sight.

    Args:
        robot: Who would stand there.
        number: Number of the fridge.
        map_: The floor.
        out: Whether the fridge is to be opened.
        config: The numbers.
    """
    config = config or FridgeConfig()
    pull = pull_of(robot.scene.front(number), out, config)
    places = Places(robot, number, pull, map_, None, config.place)
    poses = places.ranked(coming=False)
    return poses[map_.is_free(poses[:, :2])][: config.places]


def fridge_ways(
    robot: Robot, number: int, map_: NavigationMap, out: bool, config: FridgeConfig | None = None
) -> Callable[[Array], float]:
    """Returns what tells how well the door can be moved from a base pose (3,): 0 to `ALL_WAYS`.

    Up to half of that for a part of the way, more the fewer steps all of it takes.

    Args:
        robot: Who would do it.
        number: Number of the fridge.
        map_: The floor.
        out: Whether the fridge is to be opened.
        config: The numbers.
    """
    config = config or FridgeConfig()
    pull = pull_of(robot.scene.front(number), out, config)
    places = Places(robot, number, pull, map_, None, config.place)

    def ways(base: Array) -> float:
        leads = places.glance(base)
        if not leads:
            return 0.0
        if not leads[0].enough:
            return ALL_WAYS / 2 * min(leads[0].share, 1.0)
        quick, slow = config.quick_steps
        quickness = np.clip((slow - leads[0].cost) / (slow - quick), 0.0, 1.0)
        return float(ALL_WAYS / 2 * (1.0 + quickness))

    return ways


class _Fridge:
    """One door being opened or closed."""

    def __init__(
        self, robot: Robot, number: int, out: bool, region: Rectangle | None, config: FridgeConfig
    ) -> None:
        self._robot, self._number, self._out = robot, number, out
        self._region, self._config = region, config
        self._reaches = False

    @property
    def _joint(self) -> float:
        return self._robot.scene.front(self._number).joint

    @property
    def _done(self) -> bool:
        if self._out:
            return self._joint > FRIDGE_OPEN_RAD
        return self._joint <= FRIDGE_CLOSED_RAD

    def move(self) -> Motion:
        """Takes the door and leads it, again where it did not get all the way, and rests."""
        robot, failure = self._robot, None
        for _ in range(self._config.takes):
            if not self._done:
                failure = yield from self._swing()
                if failure in (None, Failure.EXECUTION) and not self._done and self._reaches:
                    continue  # it goes on from where the arm is
            began, robot.gripper = robot.steps, RELEASE
            rested = yield from self._rest()
            yield from self._wait()
            self._reaches = False
            if self._done and rested is None:
                return None
            failure = failure or rested or Failure.EXECUTION
            if failure is Failure.TARGET_PLAN and robot.steps - began <= robot.config.retries:
                break
        return failure

    def _rest(self) -> Motion:
        """Brings the arm to rest, quickly; by another way when it takes the door back."""
        robot, config, failure = self._robot, self._config, None
        timing = replace(robot.config.timing, paces=(config.rest_pace,))
        back = -1.0 if self._out else 1.0
        for _ in range(1 + robot.config.retries):
            before = self._joint

            def intact(joint: float = before) -> bool:
                return back * (self._joint - joint) < config.back_rad

            failure = yield from rest(robot, intact, timing=timing, plan=config.plan)
            if failure is not Failure.EXECUTION:
                break
        return failure

    def _swing(self) -> Motion:
        """Goes to a good place, takes the handle, leads it along its arc and lets go."""
        failure = yield from self._stand()
        if failure is not None:
            return failure
        leads = self._leads()
        if not leads:
            return Failure.TARGET_PLAN
        self._reaches = True
        failure = yield from self._take(leads)
        if failure is not None:
            return failure
        yield from self._lead(leads)
        return None

    def _look(self) -> Places:
        """Looks for places as the door is now."""
        map_ = self._robot.scene.floor_map()
        pull = pull_of(self._robot.scene.front(self._number), self._out, self._config)
        return Places(self._robot, self._number, pull, map_, self._region, self._config.place)

    def _stand(self) -> Motion:
        """Drives to the best place; an arm that has just led the door may go on as it is."""
        if self._reaches:
            if any(self._goes_on(lead) for lead in self._look().leads(None)):
                return None
            self._reaches = False
            chosen = self._choose(self._config.as_is_tries)
            if chosen is not None and chosen.whole:
                yield from self._drive(chosen)
                return None
            failure = yield from self._rest()
            if failure is not None:
                return failure
        chosen = self._choose(self._config.place.tries)
        if chosen is None:
            yield from self._tuck()
            chosen = self._choose(self._config.place.tries)
        if chosen is None:
            return Failure.TARGET_PLAN
        yield from self._drive(chosen)
        return None

    def _tuck(self) -> Motion:
        """Folds the arm, which then gets through where the resting one does not."""
        robot, config = self._robot, self._config
        robot.doing, tucked = "fold", np.array(TUCKED_QPOS_RAD)[None]
        return (yield from go(robot, robot.scene.collision(), tucked, 0.0, plan=config.plan))

    def _choose(self, tries: int) -> Chosen | None:
        """Looks closely at places, with the arm as it is, and returns the best."""
        robot = self._robot
        robot.doing = "stand"
        began = time.perf_counter()
        chosen = self._look().choose(tries, robot.steps_left - self._config.spare_steps)
        robot.spend("target", time.perf_counter() - began)
        return chosen

    def _drive(self, chosen: Chosen) -> Generator[Command, None, None]:
        if chosen.shunt is not None:
            yield from drive(self._robot, chosen.shunt, self._config.shunt)

    def _goes_on(self, lead: Lead) -> bool:
        """Whether a way takes the door on by enough, soon, to be worth another grasp from here."""
        way = abs(float(lead.joints[-1] - lead.joints[0]))
        gains = lead.whole or way > self._config.go_on
        return gains and lead.cost < self._config.go_on_steps

    def _leads(self) -> list[Lead]:
        """Returns the ways of leading the door from here, the best first."""
        robot = self._robot
        began = time.perf_counter()
        leads = self._look().leads(None, thorough=True)
        robot.spend("target", time.perf_counter() - began)
        good = [lead for lead in leads if lead.cost < leads[0].cost + self._config.as_good_steps]
        return good[: self._config.leads]

    def _take(self, leads: list[Lead]) -> Motion:
        """Takes the handle."""
        robot, config = self._robot, self._config
        robot.doing, robot.gripper = "reach", RELEASE
        failure = yield from go(
            robot,
            robot.scene.collision(),
            np.array([lead.goal for lead in leads]),
            config.reach_share,
            near_rad=config.at_handle_rad,
            plan=config.plan,
        )
        if failure is not None:
            return failure
        robot.doing, robot.gripper = "grasp", GRASP
        for _ in range(robot.config.grasp_steps):
            if self._held:
                return None
            yield robot.command()
        return Failure.EXECUTION

    def _lead(self, leads: list[Lead]) -> Generator[Command, None, None]:
        """Leads the handle along its arc, and lets go when the door stands or closes by itself."""
        robot, config, tow = self._robot, self._config, self._config.place.lead.arc.tow
        robot.doing = "pull" if self._out else "push"
        start = robot.scene.arm_qpos.copy()
        lead = min(leads, key=lambda lead: np.abs(lead.goal - start).max())
        way = np.abs(lead.joints - lead.joints[0])
        passed = np.searchsorted(way, abs(self._joint - lead.joints[0]), side="right")
        arc = np.concatenate((start[None], lead.arc[passed:]))
        bases = np.concatenate((lead.bases[:1], lead.bases[passed:]))
        path = time_path(with_base(arc, bases, tow), robot.config.timing, config.pace)
        targets, bases = without_base(path, tow)
        lets_swing = not (self._out or lead.whole)
        for step, target in enumerate(targets[: -config.brake_steps] if lets_swing else targets):
            if not self._held or self._far_enough:
                break
            now, soon = bases[np.maximum((step - tow.lag_steps, step - tow.lag_steps + 1), 0)]
            moves = rolling(robot, now, soon, tow) if lead.towed else (0.0, 0.0)
            yield robot.command(target, base=moves, pose=now if lead.towed else None)
        if not lets_swing:
            yield from self._hold(targets[-1])
        robot.gripper = RELEASE
        yield from wait(robot, config.release_steps)
        if not self._done:
            yield from draw_out(robot, config.at_handle_rad)

    def _hold(self, end: Array) -> Generator[Command, None, None]:
        """Holds the door until it is slow and far enough, or the arm at the end (7,) of its way."""
        robot, config, before = self._robot, self._config, np.inf
        relaxed = False
        for _ in range(config.hold_steps):
            slow = abs(self._joint - before) < config.slow_rad
            if self._far_enough and not relaxed:
                robot.relax()
                relaxed = True
            there = relaxed or np.abs(robot.scene.arm_qpos - end).max() < config.at_handle_rad
            if not self._held or (slow and there):
                break
            before = self._joint
            yield robot.command()

    @property
    def _held(self) -> bool:
        return self._robot.scene.front(self._number).held

    @property
    def _far_enough(self) -> bool:
        """Whether the door has come to where the hand is to leave it."""
        if self._out:
            return self._joint >= self._config.let_go
        return self._joint <= self._config.close_to + 0.02

    def _wait(self) -> Generator[Command, None, None]:
        """Waits while the door swings on."""
        robot, before, still = self._robot, self._joint, 0
        robot.doing = "wait"
        for _ in range(self._config.wait_steps):
            if self._done or still >= self._config.patience_steps:
                return
            yield robot.command()
            still = still + 1 if abs(self._joint - before) < self._config.still_rad else 0
            before = self._joint
