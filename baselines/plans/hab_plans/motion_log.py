"""Time limits and trace of the motions of one episode."""

from __future__ import annotations

from typing import Any, Generic, TypeVar

from hab_plans.belief import believed
from hab_plans.motion import Failure, Motion
from hab_plans.problem import Atom, task_of
from hab_plans.protocols import Robot

R = TypeVar("R", bound=Robot)


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
