"""Task plans carried out skill by skill, with navigation before each interaction (S H.1)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import numpy as np
from hab_planner.errors import NoPlanError
from hab_planner.observe import start_given
from hab_planner.plan import Action, Plan, saved_plan
from hab_planner.problem import Atom, atoms_of, problem_of, task_of

from hab_spa.motion.drive import DriveConfig, leave
from hab_spa.motion.rest import rest
from hab_spa.motion.robot import Motion, Robot
from hab_spa.results import Failure
from hab_spa.tasks.interactions import Hands, Interaction, believed, interaction
from hab_spa.tasks.navigate import Errand, Navigator
from hab_spa.tasks.standing import Standing, StandingConfig, choose
from hab_tasks.constants import (
    NAVIGATE_HORIZON_STEPS,
    REST_POSITION_M,
    REST_RADIUS_M,
    SKILL_HORIZON_STEPS,
)


@dataclass(frozen=True, kw_only=True)
class TaskConfig:
    """How a plan is carried out.

    Attributes:
        skill_steps, navigate_steps: Longest time for a skill (S H.2).
        tries: From how many places a skill is tried.
        standing: How these places are chosen.
        replans: How often a new plan is made from what is observed after a failure.
    """

    skill_steps: int = SKILL_HORIZON_STEPS
    navigate_steps: int = NAVIGATE_HORIZON_STEPS
    tries: int = 4
    standing: StandingConfig = field(default_factory=StandingConfig)
    replans: int = 6


class Executor:
    """Carries out the plan of one task, for one robot."""

    def __init__(
        self,
        env_id: str,
        robot: Robot,
        navigator: Navigator,
        config: TaskConfig,
        hands: Hands,
        guide: Robot | None = None,
    ) -> None:
        """Takes the saved plan of a task.

        Args:
            env_id: The task.
            robot: Who does it.
            navigator: How it gets about.
            config: How the plan is carried out.
            hands: How it takes and puts down things.
            guide: By what is known here places are chosen, for navigators that ask for one: the
                robot itself, or one that knows the truth.
        """
        self._hands, self._guide = hands, guide or robot
        self._env_id, self._task = env_id, task_of(env_id)
        self._robot, self._navigator, self._config = robot, navigator, config
        self._tried: dict[tuple[Action, frozenset[Atom]], list[Standing]] = {}
        self._end = robot.deadline

    def run(self) -> Motion:
        """Carries out the plan; plans again from what is observed when an action fails."""
        robot, plan = self._robot, saved_plan(self._env_id)
        for _ in range(1 + self._config.replans):
            robot.failure = yield from self._carry_out(plan)
            if robot.steps >= self._end:
                break
            try:
                # After the last action too: what was done first may have come undone.
                plan = self._replanned()
            except NoPlanError:
                break
            if not plan.actions:
                robot.failure = None
                break
        robot.doing = "done" if robot.failure is None else f"failed: {robot.failure.value}"
        return robot.failure

    def _replanned(self) -> Plan:
        """Returns a plan from what is believed to hold now."""
        from hab_planner.solve import solve  # takes a second, and only a failure needs it

        start = start_given(self._env_id, believed(self._task, self._robot.scene))
        return solve(problem_of(self._env_id).started(start))

    def _carry_out(self, plan: Plan) -> Motion:
        actions = [action for action in plan.actions if action.name != "navigate"]
        for number, action in enumerate(actions, 1):
            self._step = f"{number}/{len(actions)} {action}"
            failure = yield from self._at_work(interaction(self._task, action, self._hands))
            if failure is not None:
                return failure
        return None

    def _at_work(self, item: Interaction) -> Motion:
        """Drives to where a skill can be done and does it; elsewhere when it does not work out."""
        robot = self._robot
        before = believed(self._task, robot.scene)
        tried = self._tried.setdefault((item.action, before), [])  # by an earlier plan, too
        failure: Failure | None = Failure.EXECUTION  # no time is left
        for _ in range(self._config.tries):
            yield from self._fold()
            if robot.steps >= self._end:
                break
            map_ = robot.scene.floor_map()
            errand = Errand(
                point_m=item.point_m(robot),
                map=map_,
                place=partial(choose, self._guide, item, map_, tried, self._config.standing),
            )
            going = self._navigator(robot, errand)
            failure = yield from self._timed("navigate", going, self._config.navigate_steps)
            if failure is Failure.TARGET_PLAN:  # there is no other place
                tried.clear()  # the next plan may find another way from one of these
                break
            if failure is None:
                failure = yield from self._timed(
                    str(item.action), item.skill(robot), self._config.skill_steps
                )
            now = believed(self._task, robot.scene)
            if atoms_of(self._task, item.effect) <= now:
                return None
            robot.failure = failure = failure or Failure.EXECUTION
            if now != before:  # something else has happened, which asks for another plan
                break
        return failure

    def _fold(self) -> Motion:
        """Brings the arm to rest, which driving asks for; drives back where it has no room."""
        robot = self._robot
        if self._rests():
            return None
        failure = yield from self._timed("rest", rest(robot), self._config.skill_steps)
        if failure is None:
            return None
        yield from leave(robot, robot.scene.floor_map(), DriveConfig())
        return (yield from self._timed("rest", rest(robot), self._config.skill_steps))

    def _rests(self) -> bool:
        ee_m = self._robot.kinematics.ee_pose(self._robot.scene.arm_qpos)[:3, 3]
        return bool(np.linalg.norm(ee_m - REST_POSITION_M) < REST_RADIUS_M)

    def _timed(self, what: str, motion: Motion, steps: int) -> Motion:
        """Does something within so many steps, and writes down what was believed and done."""
        robot = self._robot
        robot.deadline = min(robot.steps + steps, self._end)
        entry = {
            "step": robot.steps,
            "action": self._step,
            "did": what,
            "believed": [" ".join(atom) for atom in sorted(believed(self._task, robot.scene))],
        }
        robot.trace.append(entry)
        failure = yield from self._until(motion, robot.deadline)
        entry["steps"] = robot.steps - entry["step"]
        entry["outcome"] = "done" if failure is None else failure.value
        return failure

    def _until(self, motion: Motion, deadline: int) -> Motion:
        """Lets a skill act until it is over or out of time."""
        robot = self._robot
        slack = robot.config.follow.settle_steps
        while robot.steps < deadline + slack:
            try:
                command = next(motion)
            except StopIteration as end:
                return end.value
            robot.doing = f"{self._step}: {robot.doing.rsplit(': ', 1)[-1]}"
            yield command
        motion.close()
        robot.relax()
        return Failure.EXECUTION
