"""Execution of a task's plan, stage by stage, with hand-over between skills (S H.1, H.2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from hab_plans.errors import NoPlanError
from hab_plans.plan import Action, Plan, plan_of
from hab_spa.motion.moves import RETURN_SHARE, follow, wait
from hab_spa.motion.robot import RELEASE, Motion, Robot
from hab_spa.results import Failure
from hab_spa.tasks.stages import Stages

from hab_tasks.constants import SKILL_HORIZON_STEPS
from hab_tasks.robots.robot import ROBOT
from hab_tp_srl.ending import achieved
from hab_tp_srl.options import TeamOptions
from hab_tp_srl.policies import Turn
from hab_tp_srl.stage import Stage, stage_of
from hab_tp_srl.team import Team, Tries
from hab_tp_srl.view import TaskView

RELEASE_STEPS = 4
RESET_RAD = 0.05
"""Largest joint error of an arm that has been reset (Habitat's `ResetArmSkill`)."""

RESET_STEPS = 100


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
        self._tries: dict[Action, Tries] = {}
        self._drive: Turn | None = None

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
        tries = self._tries.setdefault(stage.action, Tries())
        tries.before = self._drive
        for attempt in range(1 + self._options.retries):
            now = {**facts, "attempt": attempt}
            yield from self._fold(stage)
            if self._recovers and self._holds_other(stage, attempt):
                yield from stages.timed("release", self._release(), RELEASE_STEPS)
            if stages.over:
                break
            if stage.skill != "place" or robot.scene.holding:
                going = team.go(robot, stages.task, stage, self._view, tries)
                failure = yield from stages.timed("navigate", going, team.navigation_steps, **now)
                if failure is Failure.TARGET_PLAN:  # there is no other base pose
                    tries.standings.clear()
                    break
                yield from self._reset_there(stage, tries)
                self._drive = tries.before
            skill = team.skill(robot, stages.task, stage, self._view)
            now |= {"by": team.executor(stage), "start": team.start(stage, self._view)}
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
        """Moves the arm to rest before a stage.

        Before a planned skill and to recover from a failure, it is planned if it can be. Before a
        learned skill, the arm is reset as by Habitat's ``reset_arm``: a hand that is merely near
        its resting position can hold an object below the top of a table.
        """
        off_rest = not self._stages.rests()
        if off_rest and (self._recovers or self._team.is_planned(stage)):
            if self._team.privileged:
                yield from self._stages.fold(SKILL_HORIZON_STEPS)
            else:
                yield from self._stages.timed("rest", self._reset(), SKILL_HORIZON_STEPS)
        yield from self._reset_arm(stage)
        return None

    def _reset_there(self, stage: Stage, tries: Tries) -> Motion:
        """Moves the arm to rest where a learned skill begins.

        A hand that met a wall on the way is reset farther back, where the arm has room. If
        something is between the hand and its resting position even there, the way is planned.
        """
        robot, team, timed = self._robot, self._team, self._stages.timed
        yield from self._reset_arm(stage)
        if not self._needs_reset(stage):
            return None
        steps = team.navigation_steps
        yield from timed("navigate", team.back_off(robot), steps)
        yield from self._reset_arm(stage)
        if self._needs_reset(stage) and team.privileged:
            yield from self._stages.fold(SKILL_HORIZON_STEPS)
            yield from self._reset_arm(stage)
        again = team.go_again(robot, self._stages.task, stage, self._view, tries)
        yield from timed("navigate", again, steps)
        return None

    def _needs_reset(self, stage: Stage) -> bool:
        gap_rad = np.abs(self._robot.scene.arm_qpos - np.array(ROBOT.rest_qpos_rad)).max()
        resets = self._options.resets_arm and not self._team.is_planned(stage)
        return resets and gap_rad > RESET_RAD

    def _reset_arm(self, stage: Stage) -> Motion:
        """Moves the arm to rest for a learned skill."""
        if self._needs_reset(stage):
            yield from self._stages.timed("reset", self._reset(), RESET_STEPS)
        return None

    def _reset(self) -> Motion:
        """Moves the arm straight to its resting configuration."""
        path = np.stack((self._robot.scene.arm_qpos, np.array(ROBOT.rest_qpos_rad)))
        return (yield from follow(self._robot, path, RETURN_SHARE))


def fault(trace: Sequence[dict[str, Any]]) -> str | None:
    """Returns the failure category of an episode: the first stage that was not achieved, and why.

    Args:
        trace: Trace of the robot; the last plan and each stage's last attempt count.

    Returns:
        E.g. ``pick timeout``, ``pick failed`` for a skill that ended without its effect, or
        ``navigate timeout``; with ``, new start`` if the skill began in a state that its training
        does not know. None if every stage was achieved.
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
                return f"{entry['did']} {outcome}{_start_of(entry)}"
        return f"{here[-1]['did']} failed{_start_of(here[-1])}"
    return None


def _start_of(entry: Mapping[str, Any]) -> str:
    return ", new start" if entry.get("start") == "new" else ""


def _interactions(plan: Plan) -> list[Action]:
    return [action for action in plan.actions if action.name != "navigate"]
