"""The Pick skill as sense, plan and act (S App. D), for one environment row.

Plan a grasp, move there, grasp, plan the way back with the object in the collision model, move
to the resting pose. When execution fails, everything is planned again while steps remain.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from enum import Enum, auto

import numpy as np

from hab_spa.arm_plan import Ends, PlanConfig, plan_path
from hab_spa.collision import ArmCollision, ShapeCache
from hab_spa.escape import EscapeConfig, escape
from hab_spa.follow import FollowConfig, Follower
from hab_spa.ik import BatchArm
from hab_spa.joint_goal import GoalConfig, sample_grasp_goals, sample_rest_goals
from hab_spa.path import TimingConfig, time_path_within
from hab_spa.results import Failure, PathResult
from hab_spa.shapes import Array
from hab_tasks.constants import SKILL_HORIZON_STEPS
from hab_tasks.privileged import PrivilegedState

GRASP, RELEASE = 1.0, -1.0


class Phase(Enum):
    """What the skill is doing."""

    PLAN_REACH = auto()
    REACH = auto()
    GRASP = auto()
    PLAN_RETURN = auto()
    RETURN = auto()
    STOPPED = auto()


@dataclass(frozen=True, kw_only=True)
class PickConfig:
    """The skill's numbers.

    Attributes:
        horizon_steps: Length of the episode; long paths are followed faster to end within it.
        retries: How often the skill plans again after an execution failure.
        grasp_steps: The grasp must hold after this many steps.
        hold_steps: The return is planned this many steps after the grasp, when the object has
            stopped moving in the gripper.
        goal, plan, escape, timing, follow: Numbers of the stages.
    """

    horizon_steps: int = SKILL_HORIZON_STEPS
    retries: int = 2
    grasp_steps: int = 15
    hold_steps: int = 1
    goal: GoalConfig = field(default_factory=GoalConfig)
    plan: PlanConfig = field(default_factory=PlanConfig)
    escape: EscapeConfig = field(default_factory=EscapeConfig)
    timing: TimingConfig = field(default_factory=TimingConfig)
    follow: FollowConfig = field(default_factory=FollowConfig)


class PickSkill:
    """State machine of one row.

    Attributes:
        failure: Why the skill has stopped or is planning again; None while all goes well.
        timings_s: Time spent on ``target`` (goal sampling), ``motion`` (motion planning) and
            ``plan`` (their sum) in this episode [s].
        replans: How often execution failed so far.
    """

    def __init__(self, seed: int, config: PickConfig, cache: ShapeCache | None = None) -> None:
        """Makes the skill for one episode; `cache` may be shared by the episodes of one row."""
        self.failure: Failure | None = None
        self.timings_s = {"target": 0.0, "motion": 0.0, "plan": 0.0}
        self.replans = 0
        self._config, self._arm, self._cache = config, BatchArm(), cache or ShapeCache()
        self._seeds = np.random.default_rng(seed)
        self._phase = Phase.PLAN_REACH
        self._phase_steps = 0
        self._steps = 0
        self._follower: Follower | None = None
        self._hold_rad: Array | None = None

    def act(self, state: PrivilegedState) -> tuple[Array, float]:
        """Returns the joint targets (7,) [rad] and the gripper's action for one control step."""
        if self._hold_rad is None:
            self._hold_rad = state.arm_qpos.copy()
        self._phase_steps += 1
        self._steps += 1
        if self._phase is Phase.PLAN_REACH:
            self._plan_reach(state)
        if self._phase is Phase.REACH:
            self._reach(state)
        if self._phase is Phase.GRASP:
            self._grasp(state)
        if self._phase is Phase.PLAN_RETURN:
            self._plan_return(state)
        if self._phase is Phase.RETURN:
            self._return(state)
        closed = self._phase not in (Phase.PLAN_REACH, Phase.REACH) and (
            self._phase is not Phase.STOPPED or state.held is not None
        )
        return self._hold_rad, GRASP if closed else RELEASE

    def _enter(self, phase: Phase) -> None:
        self._phase, self._phase_steps = phase, 0

    def _next_seed(self) -> int:
        return int(self._seeds.integers(2**31 - 1))

    def _spend(self, stage: str, seconds: float) -> None:
        self.timings_s[stage] += seconds
        self.timings_s["plan"] += seconds

    def _stop(self, failure: Failure) -> None:
        self.failure = failure
        self._enter(Phase.STOPPED)

    def _execution_failed(self, state: PrivilegedState) -> None:
        """Plans again from where the arm is, a few times."""
        if self.replans >= self._config.retries:
            self._stop(Failure.EXECUTION)
            return
        self.replans += 1
        self._hold_rad = state.arm_qpos.copy()
        self._enter(Phase.PLAN_RETURN if state.held == state.target else Phase.PLAN_REACH)

    def _follow(self, path: Array, steps: int) -> None:
        targets = time_path_within(path, steps, self._config.timing)
        self._follower = Follower(targets, self._config.follow)

    def _plan_reach(self, state: PrivilegedState) -> None:
        began = time.perf_counter()
        collision = ArmCollision(state, cache=self._cache)
        goals = sample_grasp_goals(
            state, collision, self._arm, self._next_seed(), self._config.goal
        )
        self._spend("target", time.perf_counter() - began)
        if goals.failure is not None:
            self._stop(goals.failure)
            return
        start = state.arm_qpos.copy()
        ends = [Ends(open=start, tight=goal) for goal in goals.goals]
        result = plan_path(collision, self._arm, ends, self._next_seed(), self._config.plan)
        self._start(result, Phase.REACH)

    def _plan_return(self, state: PrivilegedState) -> None:
        if self._phase_steps < self._config.hold_steps:
            return
        began = time.perf_counter()
        collision = ArmCollision(state, held=state.held, cache=self._cache)
        goals = sample_rest_goals(collision, self._arm, self._next_seed(), self._config.goal)
        self._spend("target", time.perf_counter() - began)
        if goals.failure is not None:
            self._stop(goals.failure)
            return
        self._start(self._return_path(state, collision, goals.goals), Phase.RETURN)

    def _return_path(
        self, state: PrivilegedState, collision: ArmCollision, goals: Array
    ) -> PathResult:
        """Escapes from contact, then plans; without an escape the planner starts in contact."""
        began, start = time.perf_counter(), state.arm_qpos.copy()
        way_out = escape(collision, self._arm, start, self._config.escape)
        if not len(way_out):
            way_out = start[None]
        ends = [Ends(open=goal, tight=way_out[-1]) for goal in goals]
        result = plan_path(
            collision,
            self._arm,
            ends,
            self._next_seed(),
            self._config.plan,
            touch_m=self._config.escape.touch_m,
        )
        if result.path is not None:
            result = replace(result, path=np.concatenate((way_out, result.path[-2::-1])))
        return replace(result, seconds=time.perf_counter() - began)

    def _start(self, result: PathResult, phase: Phase) -> None:
        self._spend("motion", result.seconds)
        if result.path is None:
            self._stop(Failure.MOTION_PLAN)
            return
        left = self._config.horizon_steps - self._steps - self._config.follow.settle_steps
        self._follow(result.path, left if phase is Phase.RETURN else left // 2)
        self._enter(phase)

    def _reach(self, state: PrivilegedState) -> None:
        assert self._follower is not None
        self._hold_rad = self._follower.advance(state.arm_qpos)
        if self._follower.lost():
            self._execution_failed(state)
        elif self._follower.settled(state.arm_qpos):
            self._enter(Phase.GRASP)

    def _grasp(self, state: PrivilegedState) -> None:
        if state.held == state.target:
            self._enter(Phase.PLAN_RETURN)
        elif state.held is not None or self._phase_steps > self._config.grasp_steps:
            self._execution_failed(state)

    def _return(self, state: PrivilegedState) -> None:
        assert self._follower is not None
        self._hold_rad = self._follower.advance(state.arm_qpos)
        if state.held != state.target or self._follower.lost():
            self._execution_failed(state)
