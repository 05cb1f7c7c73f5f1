"""Execution of a task's plan, stage by stage, with hand-over between skills (S H.1, H.2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from hab_planner.errors import NoPlanError
from hab_planner.plan import Action, Plan, plan_of
from hab_spa.motion.moves import RETURN_SHARE, follow, wait
from hab_spa.motion.robot import RELEASE, Motion, Robot
from hab_spa.results import Failure
from hab_spa.tasks.stages import Stages
from hab_spa.tasks.standing import Standing

from hab_tasks.constants import NAVIGATE_HORIZON_STEPS, SKILL_HORIZON_STEPS
from hab_tasks.robots.robot import ROBOT
from hab_tp_srl.ending import achieved
from hab_tp_srl.options import TeamOptions
from hab_tp_srl.stage import Stage, stage_of
from hab_tp_srl.team import Team
from hab_tp_srl.view import TaskView

RELEASE_STEPS = 4


class Executor:
    """Executes the plan of one task with one robot.

    Without retries and replans, as in the paper, each stage is tried once, and the next one begins
    when its skill has ended, whether by its own condition or at its horizon.
    """

    def __init__(
        self, env_id: str, robot: Robot, team: Team, view: TaskView, options: TeamOptions
    ) -> None:
        """Creates the executor.

        Args:
            env_id: Environment id of the task.
            robot: The robot.
            team: Who executes what.
            view: What the robot observes.
            options: The agent's options.
        """
        self._env_id, self._robot, self._team, self._view = env_id, robot, team, view
        self._stages = Stages(env_id, robot, believes=team.privileged)
        self._options = options
        self._tried: dict[Action, list[Standing]] = {}

    def run(self) -> Motion:
        """Executes the plan, and further ones from the true state while there are replans."""
        plan, replans = plan_of(self._env_id), self._options.replans
        for number in range(1 + replans):
            yield from self._carry_out(plan, number)
            if self._stages.over or number == replans:
                break
            try:
                plan = self._stages.replanned()
            except NoPlanError:
                break
            skills = {action.skill for action in _interactions(plan)}
            if not skills or not skills <= self._team.policies.keys():
                break
        self._robot.doing = "done" if fault(self._robot.trace) is None else "ended"
        return None

    def _carry_out(self, plan: Plan, number: int) -> Motion:
        """Executes the stages of a plan; if there are replans left, up to the first failure."""
        actions = _interactions(plan)
        for place, action in enumerate(actions, 1):
            if self._stages.over:
                break
            stage = stage_of(self._stages.task, action)
            facts = {"plan": number, "stage": place, "skill": stage.skill}
            self._stages.label = f"{place}/{len(actions)} {action}"
            done = yield from self._stage(stage, facts)
            if done is not None and number < self._options.replans:
                break
        return None

    def _stage(self, stage: Stage, facts: dict[str, Any]) -> Motion:
        """Tries a stage; returns None if it was achieved, as far as the robot knows."""
        robot, stages, team = self._robot, self._stages, self._team
        tried = self._tried.setdefault(stage.action, [])
        for attempt in range(1 + self._options.retries):
            now = {**facts, "attempt": attempt}
            yield from self._fold(stage)
            if self._recovers and self._holds_other(stage, attempt):
                yield from stages.timed("release", self._release(), RELEASE_STEPS)
            if stages.over:
                break
            if stage.skill != "place" or robot.scene.holding:
                going = team.go(robot, stages.task, stage, self._view, tried)
                failure = yield from stages.timed("navigate", going, NAVIGATE_HORIZON_STEPS, **now)
                if failure is Failure.TARGET_PLAN:  # there is no other base pose
                    tried.clear()
                    break
            skill = team.skill(robot, stages.task, stage, self._view)
            now["by"] = team.executor(stage)
            failure = yield from stages.timed(stage.skill, skill, team.skill_steps(stage), **now)
            if self._judged(stage, failure):
                return None
        return Failure.EXECUTION

    def _judged(self, stage: Stage, failure: Failure | None) -> bool:
        """Adds to the trace whether a stage was achieved; returns whether the robot thinks so."""
        believed = failure is None
        entry = self._robot.trace[-1]
        entry["achieved"] = believed
        if self._team.privileged:
            entry["achieved"] = achieved(self._stages.task, stage, self._robot.scene)
        knows = self._team.true_knowledge or self._team.is_planned(stage)
        return entry["achieved"] if knows else believed

    @property
    def _recovers(self) -> bool:
        return self._options.retries > 0 or self._options.replans > 0

    def _holds_other(self, stage: Stage, attempt: int) -> bool:
        """Returns whether the hand holds what it should not at the start of a stage."""
        scene = self._robot.scene
        if stage.skill == "place" or not scene.holding:
            return False
        if stage.skill == "pick" and self._team.true_knowledge:
            return not scene.holds(stage.object)
        # After a pick that timed out, it may be the target.
        return stage.skill != "pick" or attempt == 0

    def _release(self) -> Motion:
        """Opens the hand."""
        self._robot.gripper = RELEASE
        yield from wait(self._robot, RELEASE_STEPS)
        return None

    def _fold(self, stage: Stage) -> Motion:
        """Moves the arm to rest before a planned skill, or to recover from a failure."""
        if self._stages.rests() or not (self._recovers or self._team.is_planned(stage)):
            return None
        if self._team.privileged:
            return (yield from self._stages.fold(SKILL_HORIZON_STEPS))
        back = follow(
            self._robot,
            np.stack((self._robot.scene.arm_qpos, np.array(ROBOT.rest_qpos_rad))),
            RETURN_SHARE,
        )
        return (yield from self._stages.timed("rest", back, SKILL_HORIZON_STEPS))


def fault(trace: Sequence[dict[str, Any]]) -> str | None:
    """Returns the failure category of an episode: the first stage that was not achieved, and why.

    Args:
        trace: Trace of the robot; the last plan and each stage's last attempt count.

    Returns:
        E.g. ``pick timeout``, ``pick failed`` for a skill that ended without its effect, or
        ``navigate timeout``; None if every stage was achieved.
    """
    tries = [entry for entry in trace if "stage" in entry]
    last = [entry for entry in tries if entry["plan"] == tries[-1]["plan"]]
    for place in sorted({entry["stage"] for entry in last}):
        here = [entry for entry in last if entry["stage"] == place]
        here = [entry for entry in here if entry["attempt"] == here[-1]["attempt"]]
        if here[-1].get("achieved"):
            continue
        for entry in here:
            outcome = entry.get("outcome", "timeout")
            if outcome != "done":
                return f"{entry['did']} {outcome}"
        return f"{here[-1]['did']} failed"
    return None


def _interactions(plan: Plan) -> list[Action]:
    return [action for action in plan.actions if action.name != "navigate"]
