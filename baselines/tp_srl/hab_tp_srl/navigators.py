"""Navigation between skills: an oracle, or a learned policy, also one with a map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from hab_navigator.belief import Reach
from hab_navigator.navigator import REPEAT, Navigator
from hab_navigator.network import load
from hab_plans.motion import Motion
from hab_plans.plan import Action
from hab_plans.protocols import NavigationRequest
from hab_plans.stage import Stage
from hab_spa.motion.drive import DriveConfig, leave, reverse
from hab_spa.motion.robot import Robot
from hab_spa.shapes import Array
from hab_spa.tasks.navigate import OracleNavigator

from hab_tasks.agent import AgentSetup, of_rows
from hab_tasks.constants import NAVIGATE_HORIZON_STEPS
from hab_tasks.envs import ENVS
from hab_tasks.registration import imported_id
from hab_tasks.robots.control import HabControllerConfig, control_configs
from hab_tp_srl.policies import AgentPolicy, SkillPolicy, Turn
from hab_tp_srl.skill import learned_navigation, turn_of
from hab_tp_srl.view import TaskView

ORACLE_STEPS = 1000
"""Maximum number of steps of the oracle's navigation: twice Navigate's horizon, as the longest ways
through the apartment take it."""

MOVED_M = 0.1
"""A point that has moved so far since the last way to it needs a way of its own."""


class ReturningOracle(OracleNavigator):
    """Drives with ground truth; also back, to make room for the arm."""

    def __init__(self) -> None:
        super().__init__(horizon_steps=ORACLE_STEPS)

    def back_off(self, robot: Robot) -> Motion:
        """Drives straight back, if there is room on the map."""
        robot.doing = "navigate"
        yield from leave(robot, robot.scene.floor_map(), DriveConfig())
        return None

    def go_again(self, robot: Robot, request: NavigationRequest) -> Motion:
        """Returns to the base pose that it was at."""
        return self.drive(robot, request.tried[-1])


class LearnedNavigator:
    """Drives by a policy in one episode, with what the policy keeps between stages."""

    def __init__(
        self,
        policy: SkillPolicy | NavigatorPolicy,
        learned: Mapping[str, SkillPolicy | AgentPolicy],
        view: TaskView,
    ) -> None:
        """Starts an episode.

        Args:
            policy: The policy.
            learned: The skills between which it drives.
            view: What the robot observes.
        """
        self._policy, self._learned, self._view = policy, learned, view
        self._turns: dict[Action, tuple[Turn, Array]] = {}
        self._last: Turn | None = None
        self.horizon_steps = policy.horizon_steps

    def go(self, robot: Robot, request: NavigationRequest) -> Motion:
        """Drives to where the policy stops; a further attempt may go on with the last one."""
        stage, point_m = request.stage, self._view.point(request.stage)
        turn, last_m = self._turns.get(stage.action, (None, point_m))
        # What fell down meanwhile is to be found elsewhere.
        moved = float(np.linalg.norm(point_m - last_m)) > MOVED_M
        stands = self._stands(stage.skill) and not moved
        if turn is None or not stands or not self._policy.goes_on(turn):
            turn = turn_of(robot, self._policy)
            turn.before = self._last
            turn.reach = self._reach(stage)
            self._turns[stage.action], self._last = (turn, point_m), turn
        return learned_navigation(robot, stage, turn, self._view)

    def _stands(self, skill: str) -> bool:
        """Whether the base stands still in a skill, after which the policy can go on."""
        policy = self._learned.get(skill)
        return policy is not None and policy.control.base == "still"

    def _reach(self, stage: Stage) -> Reach | None:
        """Returns where a skill can start, as far as its training tells."""
        policy = self._learned.get(stage.skill)
        if policy is None or policy.starts is None:
            return None
        return policy.starts.reach(level=stage.handles_object and stage.drawer is None)

    def back_off(self, robot: Robot) -> Motion:
        """Drives straight back until something is in the way, without a map."""
        robot.doing, config = "navigate", DriveConfig()
        return (yield from reverse(robot, config.before_m, config))

    def go_again(self, robot: Robot, request: NavigationRequest) -> Motion:
        """Returns to where the policy likes best now."""
        return self.go(robot, request)


class NavigatorPolicy:
    """Navigates as a skill of a task, to the first stop, with one map for the whole episode.

    If the stage is tried again, it excludes the places where it stopped before, and goes to another
    one. The attributes are those of `SkillPolicy`.
    """

    name = "navigator"
    horizon_steps = NAVIGATE_HORIZON_STEPS
    obs_mode = "depth"
    sees_handles, sees_images, finds_held = False, True, False
    starts = None

    def __init__(self, setup: AgentSetup, path: Path) -> None:
        """Loads the weights of a file.

        Raises:
            PolicyFileError: The file cannot be used.
        """
        self._network, self._device = load(path)[0].to(setup.device), setup.device
        self._robot = ENVS[imported_id(setup.env_id)].env.robot
        self.control: HabControllerConfig = control_configs(self._robot)["base_discrete"]

    def goes_on(self, turn: Turn) -> bool:
        """See `SkillPolicy.goes_on`; the next step is one in which it acts."""
        turn.age = -(-turn.age // REPEAT) * REPEAT
        return True

    def decide(self, rows: Sequence[int], turns: Sequence[Turn], obs: Mapping[str, Any]) -> None:
        """See `SkillPolicy.decide`."""
        for row, turn in zip(rows, turns, strict=True):
            if turn.age == 0:
                # A stop ends the skill, so that it must be at the goal.
                last = None if turn.before is None else turn.before.memory
                map_ = None if last is None else last.map
                turn.memory = Navigator(
                    self._robot, self._network, self._device, "once", map_, turn.reach
                )
                turn.before = None
            if turn.age % REPEAT == 0:
                images = of_rows(obs, [row])["sensor_data"]
                action = turn.memory.action(
                    np.asarray(images["head"]["depth"][0]),
                    turn.entries["extra", "point_in_base"].astype(float),
                    bool(turn.entries["agent", "is_holding"].item() > 0),
                    turn.base,
                )
                turn.action = np.array([action])
            turn.age += 1
