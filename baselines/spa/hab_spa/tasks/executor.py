"""Execution of task plans by skills, with navigation before each interaction (S H.1)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

from hab_plans.errors import NoPlanError
from hab_plans.plan import Action, Plan, plan_of
from hab_plans.problem import Atom, atoms_of

from hab_spa.motion.robot import Motion, Robot
from hab_spa.results import Failure
from hab_spa.tasks.interactions import Hands, Interaction, interaction
from hab_spa.tasks.navigate import NavigationRequest, Navigator
from hab_spa.tasks.stages import Stages
from hab_spa.tasks.standing import Standing, StandingConfig, choose
from hab_tasks.constants import NAVIGATE_HORIZON_STEPS, SKILL_HORIZON_STEPS


@dataclass(frozen=True, kw_only=True)
class TaskConfig:
    """Parameters of plan execution.

    Attributes:
        skill_steps, navigate_steps: Maximum steps per skill and per navigation (S H.2).
        tries: Maximum attempts per interaction, each from another base pose.
        standing: Parameters of base pose selection.
        replans: Maximum number of replans after a failure.
    """

    skill_steps: int = SKILL_HORIZON_STEPS
    navigate_steps: int = NAVIGATE_HORIZON_STEPS
    tries: int = 4
    standing: StandingConfig = field(default_factory=StandingConfig)
    replans: int = 6


class Executor:
    """Executes the plan of one task with one robot."""

    def __init__(
        self,
        env_id: str,
        robot: Robot,
        navigator: Navigator,
        config: TaskConfig,
        hands: Hands,
        guide: Robot | None = None,
    ) -> None:
        """Creates the executor.

        Args:
            env_id: Environment id of the task.
            robot: The robot.
            navigator: Moves the base.
            config: Parameters.
            hands: Pick and place skills.
            guide: Robot whose scene is used to choose base poses for navigators that need one: by
                default `robot`, or one with the ground-truth scene.
        """
        self._hands, self._guide = hands, guide or robot
        self._env_id, self._stages = env_id, Stages(env_id, robot)
        self._robot, self._navigator, self._config = robot, navigator, config
        self._tried: dict[tuple[Action, frozenset[Atom]], list[Standing]] = {}

    def run(self) -> Motion:
        """Executes the plan; replans from the believed state when an action fails."""
        robot, plan = self._robot, plan_of(self._env_id)
        for _ in range(1 + self._config.replans):
            robot.failure = yield from self._carry_out(plan)
            if self._stages.over:
                break
            try:
                # After the last action too: earlier effects may have been undone.
                plan = self._stages.replanned()
            except NoPlanError:
                break
            if not plan.actions:
                robot.failure = None
                break
        robot.doing = "done" if robot.failure is None else f"failed: {robot.failure.value}"
        return robot.failure

    def _carry_out(self, plan: Plan) -> Motion:
        actions = [action for action in plan.actions if action.name != "navigate"]
        for number, action in enumerate(actions, 1):
            self._stages.label = f"{number}/{len(actions)} {action}"
            failure = yield from self._at_work(interaction(self._stages.task, action, self._hands))
            if failure is not None:
                return failure
        return None

    def _at_work(self, item: Interaction) -> Motion:
        """Navigates and runs the skill of an interaction; retries from other base poses."""
        robot, stages = self._robot, self._stages
        before = stages.believed()
        tried = self._tried.setdefault((item.action, before), [])  # shared by successive plans
        failure: Failure | None = Failure.EXECUTION  # if no time is left
        for _ in range(self._config.tries):
            yield from stages.fold(self._config.skill_steps)
            if self._stages.over:
                break
            map_ = robot.scene.floor_map()
            request = NavigationRequest(
                point_m=item.point_m(robot),
                map=map_,
                choose_base_pose=partial(
                    choose, self._guide, item, map_, tried, self._config.standing
                ),
            )
            going = self._navigator(robot, request)
            failure = yield from stages.timed("navigate", going, self._config.navigate_steps)
            if failure is Failure.TARGET_PLAN:  # there is no other base pose
                tried.clear()  # the next plan may succeed from one of these
                break
            if failure is None:
                failure = yield from stages.timed(
                    str(item.action), item.skill(robot), self._config.skill_steps
                )
            now = stages.believed()
            if atoms_of(stages.task.spec, item.effect) <= now:
                return None
            robot.failure = failure = failure or Failure.EXECUTION
            if now != before:  # the state has changed otherwise, which needs another plan
                break
        return failure
