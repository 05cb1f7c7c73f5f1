"""The sense-plan-act agent of skills and task plans, and its control modes (S App. D)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np
import torch
from hab_plans.motion import Command, Motion
from torch import Tensor

from hab_spa.motion.robot import Robot, SpaConfig
from hab_spa.planning.arm_plan import PLANNERS
from hab_spa.planning.batch import kernel
from hab_spa.scenes.scene import Scene
from hab_spa.shapes import Array
from hab_tasks.agent import AgentReport, AgentSetup, AgentSpec, check_options
from hab_tasks.constants import CONTROL_HZ
from hab_tasks.envs import ENVS
from hab_tasks.errors import HabError, UnknownNameError
from hab_tasks.registration import imported_id
from hab_tasks.robots.spec import RobotSpec, robot_of

Behaviour = Callable[[Robot], Motion]


class SpaAgent:
    """Runs one behaviour per environment row."""

    def __init__(
        self,
        setup: AgentSetup,
        spec: AgentSpec,
        make_scene: Callable[[RobotSpec], Scene],
        behave: Behaviour,
        config: SpaConfig | None = None,
    ) -> None:
        """Creates the agent.

        Args:
            setup: Environment and options; the environment's horizon is the robot's deadline.
            spec: Requirements of the agent.
            make_scene: Creates the scene model of a row, for the environment's robot.
            behave: Starts the motion of a row's robot in an episode.
            config: Parameters; the paper's by default.
        """
        kernel()  # compiled or read here, not in the first plan
        self.spec = spec
        self._config, self._behave = config or SpaConfig(), behave
        self._horizon_steps = ENVS[setup.env_id].env.horizon_steps
        self._make_scene = partial(make_scene, robot_for(setup))
        self._rows: list[_Row] = []

    def reset(self, mask: Tensor, seeds: Sequence[int]) -> None:
        """Starts a new episode in the rows of `mask` (N,) bool, seeded with `seeds` (N,)."""
        if len(self._rows) != len(mask):
            self._rows = [_Row(self._make_scene(), seed) for seed in seeds]
        for number in torch.nonzero(mask).flatten().tolist():
            scene = self._rows[number].scene
            scene.forget()
            self._rows[number] = _Row(scene, int(seeds[number]))

    def act(self, obs: Mapping[str, Any]) -> Tensor:
        """Returns actions (N, A) float32 in the spec's control mode."""
        robots, commands = [], []
        for number, row in enumerate(self._rows):
            row.scene.see(obs, number)
            robot = row.robot or row.begin(self._behave, self._config, self._horizon_steps)
            robot.obs = obs
            robots.append(robot)
            commands.append(row.next_command(robot))
        decided = zip(robots, self.decide(commands, obs), strict=True)
        actions = [self._action(robot, command) for robot, command in decided]
        return torch.from_numpy(np.array(actions, dtype=np.float32))

    def decide(self, commands: list[Command], obs: Mapping[str, Any]) -> list[Command]:
        """Returns the final commands of all rows; for agents that decide for several at once.

        Args:
            commands: The commands of the rows' motions.
            obs: The observation of all rows.
        """
        return commands

    def _action(self, robot: Robot, command: Command) -> Array:
        """Converts a command to an action (A,) of the control mode."""
        mode = self.spec.control_mode
        if mode == "base":
            return np.array(command.base)
        action = np.append(command.arm_rad, command.gripper)
        if mode.endswith("_base"):
            return np.concatenate((action, command.base))
        if mode.endswith("_pose"):
            pose = (
                driven(robot.spec, robot.base, *command.base)
                if command.pose is None
                else command.pose
            )
            return np.concatenate((action, pose))
        return action

    def report(self) -> list[AgentReport]:
        """Returns each row's failure category (S App. I.1) and planning times."""
        return [row.report() for row in self._rows]


def driven(robot: RobotSpec, base: Array, forward: float, turning: float) -> Array:
    """Returns the base pose (3,) after a step of perfectly executed velocities."""
    x, y, yaw = base.tolist()
    step_m = forward * robot.base_linear_speed_m_s / CONTROL_HZ
    turned = yaw + turning * robot.base_angular_speed_rad_s / CONTROL_HZ
    return np.array((x + step_m * np.cos(yaw), y + step_m * np.sin(yaw), turned))


class _Row:
    """One row's episode."""

    def __init__(self, scene: Scene, seed: int) -> None:
        self.scene, self._seed = scene, seed
        self.robot: Robot | None = None
        self._motion: Motion | None = None

    def begin(self, behave: Behaviour, config: SpaConfig, horizon_steps: int) -> Robot:
        """Starts the robot's motion."""
        self.robot = Robot(self.scene, config, seed=self._seed, deadline=horizon_steps)
        self._motion = behave(self.robot)
        return self.robot

    def next_command(self, robot: Robot) -> Command:
        """Returns the command of the next step; after the motion the robot holds its pose."""
        command = None
        if self._motion is not None:
            try:
                command = next(self._motion)
            except StopIteration as end:
                self._motion, robot.failure = None, end.value
        if command is None:
            command = robot.command()
        robot.steps += 1
        return command

    def report(self) -> AgentReport:
        """Returns the failure category, if any, and the planning times."""
        if self.robot is None:
            return AgentReport()
        return AgentReport(
            failure=None if self.robot.failure is None else self.robot.failure.value,
            timings_s=dict(self.robot.timings_s),
            doing=self.robot.doing,
            trace=tuple(self.robot.trace),
        )


T = TypeVar("T")

CONTROLLERS = {"real": "joint_target", "perfect": "joint_state"}
"""Option ``controller``: joint targets of the simulated drives, or joint states (S App. D)."""


def skill_asked(setup: AgentSetup, agent: str, skills: Mapping[str, T]) -> tuple[str, T]:
    """Returns the environment id of a single-skill agent, and its entry in `skills`.

    Raises:
        UnknownNameError: The environment is not a supported skill, or an option is unknown.
    """
    check_options(setup, {"controller": CONTROLLERS, "planner": PLANNERS})
    env_id = imported_id(setup.env_id)
    if env_id not in skills:
        raise UnknownNameError(f"environment of {agent}", env_id, skills)
    return env_id, skills[env_id]


def robot_for(setup: AgentSetup) -> RobotSpec:
    """Returns the robot that an agent is set up for."""
    own = ENVS[imported_id(setup.env_id)].env.robot
    return own if setup.robot is None else robot_of(setup.robot)


def planned(
    setup: AgentSetup, config: SpaConfig | None = None, *, by_friction: bool = False
) -> SpaConfig:
    """Returns parameters, the paper's by default, with the planner of the option ``planner``.

    Raises:
        HabError: The robot grasps by friction, and the agent does not unless `by_friction`.
    """
    robot = robot_for(setup)
    if robot.fingers is not None and not by_friction:
        raise HabError(f"This agent does not grasp by friction, as {robot.uid} does.")
    return (config or SpaConfig()).planned_by(setup.options.get("planner", "ompl"), robot)


def control_mode(env_id: str, options: Mapping[str, str]) -> str:
    """Returns the control mode for an environment and the agent's options.

    Args:
        env_id: The environment.
        options: ``controller``, and ``navigation`` for tasks.
    """
    modes = ENVS[env_id].env.control_modes
    arm = CONTROLLERS[options.get("controller", "real")]
    if options.get("navigation") == "perfect":
        return f"{arm}_pose"
    return next((mode for mode in (arm, f"{arm}_base") if mode in modes), "base")
