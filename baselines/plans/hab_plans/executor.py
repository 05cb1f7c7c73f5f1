"""Execution of a task's plan, stage by stage, with navigation before each (S H.1, H.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from hab_plans.belief import achieved, believed, start_given
from hab_plans.motion import Failure, Motion
from hab_plans.plan import Action, Plan, plan_of
from hab_plans.problem import Atom, NoPlanError, problem_of, task_of
from hab_plans.protocols import BasePose, NavigationRequest, Robot, SkillProvider, Team
from hab_plans.stage import Stage, stage_of

R = TypeVar("R", bound=Robot)


@dataclass(frozen=True, kw_only=True)
class ExecutorConfig:
    """Parameters of plan execution.

    Attributes:
        attempts: Maximum attempts of a stage, each from another base pose.
        replans: Maximum number of plans after the first, each from the believed state.
        watches: Whether a stage ends when the believed state has changed otherwise than by its
            effect, which needs another plan; base poses are then remembered for each state.
        leaves: Whether a stage that was not achieved is left to the next plan, and the others that
            are possible without it go on, unless the hand still holds what it should place.
        goes_on: Whether a skill also starts where navigation has failed, and the last plan goes on
            after a stage that was not achieved, as the paper's do: a stage begins when the skill
            before it has ended, whether by its own condition or at its horizon.
    """

    attempts: int = 1
    replans: int = 0
    watches: bool = False
    leaves: bool = False
    goes_on: bool = False


class Executor(Generic[R]):
    """Executes the plan of one task with one robot."""

    def __init__(self, log: MotionLog[R], team: Team[R], config: ExecutorConfig) -> None:
        """Creates the executor of an episode.

        Args:
            log: Time limits and trace of the robot's motions.
            team: Who executes what.
            config: Parameters.
        """
        self._log, self._team, self._config = log, team, config
        self._tried: dict[tuple[Action, frozenset[Atom] | None], list[BasePose]] = {}

    def run(self) -> Motion:
        """Executes the plan, and further ones from the believed state when a stage fails."""
        log, config, robot = self._log, self._config, self._log.robot
        plan: Plan | None = plan_of(log.env_id)
        for number in range(1 + config.replans):
            # With plans left, planning again mends more than going on with what has failed.
            to_the_end = config.goes_on and number == config.replans
            robot.failure = yield from self._carry_out(plan, number, to_the_end)
            if log.over or to_the_end:
                break
            plan = self._next_plan()  # after the last action too: effects may have been undone
            if plan is None:
                break
            # An empty plan: the goal is believed to hold, whatever the last stage reported.
            if not plan.actions:
                robot.failure = None
                break
        robot.doing = "done" if robot.failure is None else f"failed: {robot.failure.value}"
        return robot.failure

    def _next_plan(self) -> Plan | None:
        """Returns a plan from the believed state; None if there is none that the team can do."""
        from hab_plans.solve import solve  # takes a second, after a failure only

        start = start_given(self._log.env_id, self._log.believed())
        try:
            plan = solve(problem_of(self._log.env_id).started(start))
        except NoPlanError:
            return None
        # A plan from another state may need a skill that this task's team lacks.
        known = {action.skill for action in plan.interactions} <= self._team.skills.keys()
        return plan if known else None

    def _carry_out(self, plan: Plan, number: int, to_the_end: bool) -> Motion:
        """Executes the stages of a plan; returns the first failure."""
        first: Failure | None = None
        for place, action in enumerate(plan.interactions, 1):
            if self._log.over:
                # Without time for the remaining stages the task has failed, though no stage has.
                return first or Failure.EXECUTION
            stage = stage_of(self._log.task, action)
            if self._config.leaves and not self._is_possible(action):
                continue
            self._log.label = f"{place}/{len(plan.interactions)} {action}"
            facts = {"plan": number, "stage": place, "skill": stage.skill}
            failure = yield from self._stage(stage, facts)
            first = first or failure
            if failure is not None and not to_the_end and not self._leaves():
                break
        return first

    def _leaves(self) -> bool:
        """Whether the next stage comes after one that was not achieved."""
        return self._config.leaves and not self._log.robot.scene.holding

    def _is_possible(self, action: Action) -> bool:
        """Whether the robot believes that it holds what it is to place, and its place is open."""
        believed = self._log.believed()
        closed = {
            atom[1] for atom in start_given(self._log.env_id, believed) if atom[0] == "is-closed"
        }
        if action.verb == "place" and ("holding", action.things[0]) not in believed:
            return False
        return action.verb not in ("pick", "place") or action.things[-1] not in closed

    def _stage(self, stage: Stage, facts: dict[str, Any]) -> Motion:
        """Tries a stage; returns None if it was achieved, as far as the robot knows."""
        log, team = self._log, self._team
        before = self._watched()
        tried = self._tried.setdefault((stage.action, before), [])  # shared by successive plans
        failure: Failure | None = Failure.EXECUTION  # if no time is left
        for attempt in range(self._config.attempts):
            yield from team.hand_over.prepare(stage, attempt)
            if log.over:
                break
            now = {**facts, "attempt": attempt}
            failure = yield from self._get_there(stage, tried, now)
            if failure is Failure.TARGET_PLAN:  # there is no other base pose
                tried.clear()  # the next plan may succeed from one of these
                break
            # A skill may reach what the navigator did not; its end is what counts then.
            if failure is None or self._config.goes_on:
                failure = yield from self._act(stage, now)
            failure = self._judged(stage, failure)
            if failure is None:
                break
            # What is reported if the episode ends before the plan does.
            log.robot.failure = failure
            # Another attempt would start from what the stage was not planned for.
            if self._watched() != before:
                break
        return failure

    def _get_there(self, stage: Stage, tried: list[BasePose], facts: dict[str, Any]) -> Motion:
        """Navigates to where a stage's skill can start, and makes the arm ready."""
        log, team, robot = self._log, self._team, self._log.robot
        skill = team.skills[stage.skill]
        # E.g. to place with an empty hand: the way there would only cost time.
        if not skill.can_start(robot, stage):
            return None

        def choose() -> BasePose | None:
            pose = skill.base_pose(robot, stage, tried)
            if pose is not None:
                # Also a pose that is then not reached: the next attempt is to differ.
                tried.append(pose)
            return pose

        request = NavigationRequest(stage=stage, tried=tried, choose_base_pose=choose)
        going = team.navigator.go(robot, request)
        failure = yield from log.timed("navigate", going, team.navigator.horizon_steps, **facts)
        # After a failed way too, as the skill may start where it ended.
        if failure is not Failure.TARGET_PLAN:
            yield from team.hand_over.arrive(stage, request)
        return failure

    def _act(self, stage: Stage, facts: dict[str, Any]) -> Motion:
        """Runs a stage's skill."""
        skill, robot = self._team.skills[stage.skill], self._log.robot
        motion = skill.start(robot, stage)
        facts |= {"by": skill.name, "start": skill.start_of(robot, stage)}
        return (yield from self._log.timed(stage.skill, motion, skill.horizon_steps, **facts))

    def _watched(self) -> frozenset[Atom] | None:
        return self._log.believed() if self._config.watches else None

    def _judged(self, stage: Stage, failure: Failure | None) -> Failure | None:
        """Adds to the trace whether a stage was achieved; returns None if the robot thinks so."""
        skill: SkillProvider[R] = self._team.skills[stage.skill]
        effect, log = failure is None, self._log
        if log.believes:
            effect = achieved(log.task, stage, log.robot.scene)
        log.robot.trace[-1]["achieved"] = effect
        # A robot that knows no effects takes the end of a skill for success, as the paper's do.
        if skill.knows_effect:
            return None if effect else failure or Failure.EXECUTION
        return failure


class MotionLog(Generic[R]):
    """Runs the motions of one episode.

    Attributes:
        env_id: Environment id of the task.
        task: The task.
        robot: The robot.
        believes: Whether its scene has beliefs about objects, doors and drawers.
        label: The current stage, e.g. ``3/20 pick(bowl, drawer)``.
    """

    def __init__(self, env_id: str, robot: R, *, believes: bool = True) -> None:
        """Starts an episode, which ends at the robot's deadline."""
        self.env_id, self.task, self.robot, self.label = env_id, task_of(env_id), robot, ""
        self.believes, self._end = believes, robot.deadline

    @property
    def over(self) -> bool:
        """Whether no steps are left."""
        return self.robot.steps >= self._end

    def believed(self) -> frozenset[Atom]:
        """Returns the atoms that the robot believes to hold."""
        return believed(self.task, self.robot.scene)

    def timed(self, what: str, motion: Motion, steps: int, **facts: Any) -> Motion:
        """Runs a motion with a step limit, and adds it to the trace.

        Args:
            what: The motion's name in the trace.
            motion: The motion.
            steps: The limit.
            **facts: Further JSON-serialisable entries of the trace.
        """
        robot = self.robot
        robot.deadline = min(robot.steps + steps, self._end)
        entry = {"step": robot.steps, "action": self.label, "did": what, **facts}
        if self.believes:
            entry["believed"] = [" ".join(atom) for atom in sorted(self.believed())]
        # Before the motion, so that the trace of an episode that ends within it has it.
        robot.trace.append(entry)
        failure = yield from self._until(motion, robot.deadline)
        entry["steps"] = robot.steps - entry["step"]
        entry["outcome"] = "done" if failure is None else failure.value
        return failure

    def _until(self, motion: Motion, deadline: int) -> Motion:
        """Runs a motion until it ends or exceeds its deadline."""
        robot = self.robot
        # A motion sees the deadline itself, and uses the steps after it only to come to rest.
        while robot.steps < deadline + robot.settle_steps:
            try:
                command = next(motion)
            except StopIteration as end:
                return end.value
            # A motion that has not changed its text since the last step has the label already.
            robot.doing = f"{self.label}: {robot.doing.rsplit(': ', 1)[-1]}"
            yield command
        motion.close()
        # A motion that was cut off has left targets ahead of the arm, which would go on moving.
        robot.relax()
        return Failure.EXECUTION
