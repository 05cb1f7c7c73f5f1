"""Time limits and trace of a robot that executes a task's plan, stage by stage."""

from __future__ import annotations

from typing import Any

import numpy as np
from hab_plans.observe import start_given
from hab_plans.plan import Plan
from hab_plans.problem import Atom, problem_of, task_of

from hab_spa.motion.drive import DriveConfig, leave
from hab_spa.motion.rest import rest
from hab_spa.motion.robot import Motion, Robot
from hab_spa.results import Failure
from hab_spa.tasks.interactions import believed
from hab_tasks.constants import REST_POSITION_M, REST_RADIUS_M


class Stages:
    """Runs the motions of one episode's stages.

    Attributes:
        task: The task.
        robot: The robot.
        label: The current stage, e.g. ``3/20 pick(bowl, drawer)``.
    """

    def __init__(self, env_id: str, robot: Robot, *, believes: bool = True) -> None:
        """Starts an episode.

        Args:
            env_id: Environment id of the task.
            robot: The robot; its deadline is the end of the episode.
            believes: Whether its scene has beliefs about objects, doors and drawers.
        """
        self.task, self.robot, self.label = task_of(env_id), robot, ""
        self._env_id, self._believes, self._end = env_id, believes, robot.deadline

    @property
    def over(self) -> bool:
        """Whether no steps are left."""
        return self.robot.steps >= self._end

    def believed(self) -> frozenset[Atom]:
        """Returns the atoms that the robot believes to hold."""
        return believed(self.task, self.robot.scene)

    def replanned(self) -> Plan:
        """Returns a plan from the believed state.

        Raises:
            NoPlanError: The goal cannot be reached from there.
        """
        from hab_plans.solve import solve  # a slow import, needed only after a failure

        start = start_given(self._env_id, self.believed())
        return solve(problem_of(self._env_id).started(start))

    def rests(self) -> bool:
        """Returns whether the arm is at rest."""
        ee_m = self.robot.kinematics.ee_pose(self.robot.scene.arm_qpos)[:3, 3]
        return bool(np.linalg.norm(ee_m - REST_POSITION_M) < REST_RADIUS_M)

    def fold(self, steps: int) -> Motion:
        """Moves the arm to rest before driving; backs off first if the arm has no room.

        Args:
            steps: Maximum steps of each attempt.
        """
        robot = self.robot
        if self.rests():
            return None
        failure = yield from self.timed("rest", rest(robot), steps)
        if failure is None:
            return None
        yield from leave(robot, robot.scene.floor_map(), DriveConfig())
        return (yield from self.timed("rest", rest(robot), steps))

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
        if self._believes:
            entry["believed"] = [" ".join(atom) for atom in sorted(self.believed())]
        robot.trace.append(entry)
        failure = yield from self._until(motion, robot.deadline)
        entry["steps"] = robot.steps - entry["step"]
        entry["outcome"] = "done" if failure is None else failure.value
        return failure

    def _until(self, motion: Motion, deadline: int) -> Motion:
        """Runs a motion until it ends or exceeds its deadline."""
        robot = self.robot
        slack = robot.config.follow.settle_steps
        while robot.steps < deadline + slack:
            try:
                command = next(motion)
            except StopIteration as end:
                return end.value
            robot.doing = f"{self.label}: {robot.doing.rsplit(': ', 1)[-1]}"
            yield command
        motion.close()
        robot.relax()
        return Failure.EXECUTION
