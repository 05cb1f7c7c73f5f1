"""The fridge skills: the hand grasps the handle and moves the door along its arc."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import replace

import numpy as np
from hab_plans.motion import GRASP, RELEASE, Command, Failure, Motion

from hab_spa.motion.follow import TimingConfig, time_path
from hab_spa.motion.moves import draw_out, go, rest, tucked_rad, wait
from hab_spa.motion.robot import Robot
from hab_spa.shapes import Array
from hab_spa.skills.fridge.arc import DoorPath
from hab_spa.skills.fridge.base_poses import BasePoseSearch, SelectedBasePose
from hab_spa.skills.fridge.config import ExitConfig, FridgeConfig, pull_of, wider
from hab_spa.skills.fridge.maneuver import drive
from hab_spa.skills.fridge.tow import rolling, with_base, without_base
from hab_tasks.articulations import FRIDGE_CLOSED_RAD, FRIDGE_OPEN_RAD, Rectangle
from hab_tasks.world.navigation import NavigationMap

MAX_SCORE = 12
"""Maximum of `fridge_score`."""

OPEN_SLACK_RAD = 0.03
"""Tolerance of the opening of a door that is opened farther than the success threshold."""


def open_fridge(
    robot: Robot, number: int, region: Rectangle | None = None, config: FridgeConfig | None = None
) -> Motion:
    """Opens the fridge by more than 90 degrees and rests beside the door.

    Args:
        robot: The robot.
        number: Number of the fridge among the episode's articulations.
        region: Rectangle in the fridge's frame that the base must not leave.
        config: Parameters.
    """
    return (yield from FridgeMotion(robot, number, True, region, config or FridgeConfig()).move())


def close_fridge(
    robot: Robot, number: int, region: Rectangle | None = None, config: FridgeConfig | None = None
) -> Motion:
    """Closes the fridge and rests; see `open_fridge`."""
    return (yield from FridgeMotion(robot, number, False, region, config or FridgeConfig()).move())


def fridge_base_poses(
    robot: Robot, number: int, map_: NavigationMap, out: bool, config: FridgeConfig | None = None
) -> Array:
    """Returns free base poses (K, 3) in front of a fridge, ranked by a heuristic.

    Args:
        robot: The robot.
        number: Number of the fridge.
        map_: The floor map.
        out: Whether to open the fridge.
        config: Parameters.
    """
    config = config or FridgeConfig()
    pull = pull_of(robot.scene.articulation(number), out, config)
    search = BasePoseSearch(robot, number, pull, lambda: map_, None, config.base_pose)
    poses = search.ranked(driving=False)
    return poses[map_.is_free(poses[:, :2])][: config.base_poses]


def fridge_score(
    robot: Robot, number: int, map_: NavigationMap, out: bool, config: FridgeConfig | None = None
) -> Callable[[Array], float]:
    """Returns a function that scores base poses (3,) for moving the door, from 0 to `MAX_SCORE`.

    Up to half of the score is for a partial pull; the rest is for few steps of a sufficient one.

    Args:
        robot: The robot.
        number: Number of the fridge.
        map_: The floor map.
        out: Whether to open the fridge.
        config: Parameters.
    """
    config = config or FridgeConfig()
    pull = pull_of(robot.scene.articulation(number), out, config)
    search = BasePoseSearch(robot, number, pull, lambda: map_, None, config.base_pose)

    def score(base: Array) -> float:
        candidates = search.quick_candidates(base)
        if not candidates:
            return 0.0
        if not candidates[0].sufficient:
            return MAX_SCORE / 2 * min(candidates[0].share, 1.0)
        quick, slow = config.quick_steps
        quickness = np.clip((slow - candidates[0].cost) / (slow - quick), 0.0, 1.0)
        return float(MAX_SCORE / 2 * (1.0 + quickness))

    return score


class FridgeMotion:
    """Opens or closes one door."""

    def __init__(
        self, robot: Robot, number: int, out: bool, region: Rectangle | None, config: FridgeConfig
    ) -> None:
        self._robot, self._number, self._out = robot, number, out
        self._region, self._whole = region, config
        self._config = config.nearer() if config.near_first else config
        self._open_rad, self._reaches = FRIDGE_OPEN_RAD, False
        self._planned = np.zeros((0, len(robot.scene.arm_qpos)))

    @property
    def _timing(self) -> TimingConfig | None:
        """Speed limits where the door is not moved; the robot's if None."""
        return None

    @property
    def _joint(self) -> float:
        return self._robot.scene.articulation(self._number).joint

    @property
    def _done(self) -> bool:
        if self._out:
            return self._joint > self._open_rad
        return self._joint <= FRIDGE_CLOSED_RAD - self._config.slack_rad

    def move(self) -> Motion:
        """Moves the door and rests; opens it farther if it encloses a robot that has to leave."""
        failure = yield from self._move()
        if failure is None and self._out and self._region is None:
            config = wider(self._robot, self._number, self._config, ExitConfig())
            if config is not None:
                self._config = self._whole = config
                self._open_rad = config.opened - OPEN_SLACK_RAD
                yield from self._move()  # the door is open already, so a failure is ignored
        return failure

    def _move(self) -> Motion:
        """Moves the door by repeated pulls until it is done, and rests."""
        robot, failure, in_vain = self._robot, None, 0
        for _ in range(self._config.takes):
            began = robot.steps
            if not self._done:
                failure = yield from self._swing()
                if failure in (None, Failure.EXECUTION) and not self._done and self._reaches:
                    continue  # from the current pose of the arm
            in_vain += robot.steps == began
            robot.gripper = RELEASE
            rested = yield from self._rest()
            yield from self._wait()
            self._reaches = False
            if self._done and rested is None:
                return None
            failure = failure or rested or Failure.EXECUTION
            if in_vain >= self._config.plan_tries:
                break
        return failure

    def _rest(self) -> Motion:
        """Moves the arm to rest quickly; replans if the motion moves the door back."""
        robot, config, failure = self._robot, self._config, None
        timing = replace(robot.config.timing, paces=config.rest_paces)
        back = -1.0 if self._out else 1.0
        for _ in range(1 + robot.config.retries):
            before = self._joint

            def intact(joint: float = before) -> bool:
                return back * (self._joint - joint) < config.back_rad

            failure = yield from rest(
                robot, intact, timing=timing, plan=config.plan, plans=config.rest_plans
            )
            if failure is not Failure.EXECUTION:
                break
        return failure

    def _swing(self) -> Motion:
        """Drives to a good base pose, grasps the handle, moves it along its arc and releases it."""
        failure = yield from self._stand()
        if failure is not None:
            return failure
        candidates = self._find_candidates()
        if not candidates:
            return Failure.TARGET_PLAN
        self._reaches = True
        failure = yield from self._take(candidates)
        if failure is not None:
            return failure
        yield from self._follow(candidates)
        return None

    def _search(self) -> BasePoseSearch:
        """Returns the base pose search for the current state of the door."""
        robot, number, config = self._robot, self._number, self._config
        pull = pull_of(robot.scene.articulation(number), self._out, config)
        floor_map = robot.scene.floor_map
        return BasePoseSearch(robot, number, pull, floor_map, self._region, config.base_pose)

    def _stand(self) -> Motion:
        """Drives to the best base pose; after a pull, the arm may continue without driving."""
        if self._reaches:
            if any(self._goes_on(candidate) for candidate in self._search().candidates(None)):
                return None
            self._reaches = False
            chosen = self._choose(self._config.as_is_tries)
            if chosen is not None and chosen.complete:
                yield from self._drive(chosen)
                return None
            failure = yield from self._rest()
            if failure is not None:
                return failure
        for _ in range(self._config.drives):
            chosen = self._choose(self._config.base_pose.tries)
            if chosen is None and self._config is not self._whole:
                self._config = self._whole
                continue
            if chosen is None:
                yield from self._tuck()
                chosen = self._choose(self._config.base_pose.tries)
            if chosen is None:
                return Failure.TARGET_PLAN
            if (yield from self._drive(chosen)):
                break
        return None

    def _tuck(self) -> Motion:
        """Tucks the arm, which needs less room than the resting pose."""
        robot, plan, timing = self._robot, self._config.plan, self._timing
        robot.doing, tucked = "fold", tucked_rad(robot.scene.robot)[None]
        collision = robot.scene.collision()
        return (yield from go(robot, collision, tucked, 0.0, plan=plan, timing=timing))

    def _choose(self, tries: int) -> SelectedBasePose | None:
        """Evaluates base poses with the arm as it is, and returns the best."""
        robot = self._robot
        robot.doing = "stand"
        began = time.perf_counter()
        chosen = self._search().choose(tries, robot.steps_left - self._config.spare_steps)
        robot.spend("target", time.perf_counter() - began)
        self._planned = self._planned[:0] if chosen is None else chosen.goals
        return chosen

    def _drive(self, chosen: SelectedBasePose) -> Generator[Command, None, bool]:
        if chosen.maneuver is None:
            return True
        return (yield from drive(self._robot, chosen.maneuver, self._config.maneuver))

    def _goes_on(self, candidate: DoorPath) -> bool:
        """Whether a pull from the current pose moves the door far enough at a low cost."""
        moved = abs(float(candidate.joints[-1] - candidate.joints[0]))
        gains = candidate.complete or moved > self._config.go_on
        return gains and candidate.cost < self._config.go_on_steps

    def _find_candidates(self) -> list[DoorPath]:
        """Returns the candidate pulls from the current base pose, best first."""
        robot = self._robot
        began = time.perf_counter()
        candidates = self._search().candidates(None, self._planned)
        robot.spend("target", time.perf_counter() - began)
        good = [
            candidate
            for candidate in candidates
            if candidate.cost < candidates[0].cost + self._config.as_good_steps
        ]
        return good[: self._config.candidates]

    def _take(self, candidates: list[DoorPath]) -> Motion:
        """Reaches for the handle and grasps it."""
        robot, config = self._robot, self._config
        robot.doing, robot.gripper = "reach", RELEASE
        failure = yield from go(
            robot,
            robot.scene.collision(),
            np.array([candidate.goal for candidate in candidates]),
            config.reach_share,
            near_rad=config.at_handle_rad,
            plan=config.plan,
        )
        if failure is not None:
            return failure
        robot.doing, robot.gripper = "grasp", GRASP
        for _ in range(config.grasp_steps):
            if self._held:
                return None
            yield robot.command()
        robot.scene.missed()
        self._config = config.nearer()
        return Failure.EXECUTION

    def _follow(self, candidates: list[DoorPath]) -> Generator[Command, None, None]:
        """Moves the handle along its arc; releases it when the door is still or swings closed."""
        robot, config, tow = self._robot, self._config, self._config.base_pose.door_path.arc.tow
        robot.doing = "pull" if self._out else "push"
        start = robot.scene.arm_qpos.copy()
        candidate = min(candidates, key=lambda candidate: np.abs(candidate.goal - start).max())
        moved = np.abs(candidate.joints - candidate.joints[0])
        passed = np.searchsorted(moved, abs(self._joint - candidate.joints[0]), side="right")
        arc = np.concatenate((start[None], candidate.arc[passed:]))
        bases = np.concatenate((candidate.bases[:1], candidate.bases[passed:]))
        path = time_path(with_base(arc, bases, tow), robot.config.timing, config.pace)
        targets, bases = without_base(path, tow)
        lets_swing = not (self._out or candidate.complete)
        for step, target in enumerate(targets[: -config.brake_steps] if lets_swing else targets):
            if not self._held or self._far_enough:
                break
            now, soon = bases[np.maximum((step - tow.lag_steps, step - tow.lag_steps + 1), 0)]
            moves = rolling(robot, now, soon, tow) if candidate.towed else (0.0, 0.0)
            yield robot.command(target, base=moves, pose=now if candidate.towed else None)
        if not lets_swing:
            yield from self._hold(targets[-1])
        yield from self._let_go()

    def _let_go(self) -> Generator[Command, None, None]:
        """Releases the handle."""
        robot, config = self._robot, self._config
        robot.gripper = RELEASE
        yield from wait(robot, config.release_steps)
        if not self._done:
            yield from draw_out(robot, config.at_handle_rad)

    def _hold(self, end: Array) -> Generator[Command, None, None]:
        """Holds the door until it is slow, and far enough or the arm at its final pose (J,)."""
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
        return self._robot.scene.articulation(self._number).held

    @property
    def _far_enough(self) -> bool:
        """Whether the door has reached the opening at which the hand releases it."""
        if self._out:
            return self._joint >= self._config.let_go
        return self._joint <= self._config.close_to + 0.02

    def _wait(self) -> Generator[Command, None, None]:
        """Waits while the door swings."""
        robot, before, still = self._robot, self._joint, 0
        robot.doing = "wait"
        for _ in range(self._config.wait_steps):
            if self._done or still >= self._config.patience_steps:
                return
            yield robot.command()
            still = still + 1 if abs(self._joint - before) < self._config.still_rad else 0
            before = self._joint
