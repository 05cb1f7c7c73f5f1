"""When a running skill ends, and which gripper actions it may take (S H.2).

The robot knows what it holds only by touch. A pick ends when something is held at rest, a place
when the hand is empty at rest, and a door or drawer is done when its handle has been held or, to
close it, the hand has been away, and the empty hand is at rest again. A robot that observes handles
also knows whether a door that it had opened is closed: its handle is back where it was. With ground
truth, a skill ends by the success condition of its environment.
"""

from __future__ import annotations

from hab_plans.belief import achieved
from hab_plans.motion import GRASP, RELEASE
from hab_plans.stage import Stage
from hab_spa.scenes.scene import Scene

from hab_tasks.tasks.base import Task
from hab_tp_srl.view import TaskView

OPENED_M, CLOSED_M = 0.15, 0.045
"""A handle farther from its place at the start of the episode has been opened since; one that is
as near is closed again (a drawer below 0.05 m, the fridge's door below 0.15 rad or 0.09 m)."""


class Ending:
    """Watches a running skill of one row."""

    def __init__(self, task: Task, stage: Stage, view: TaskView, truth: Scene | None) -> None:
        """Starts to watch.

        Args:
            task: The task.
            stage: The stage.
            view: What the robot observes.
            truth: A scene with ground truth; None if the robot has to do without.
        """
        self._task, self._stage, self._view, self._truth = task, stage, view, truth
        self._held = self._left = self._released = False
        self._was_opened = self._handle_moved_m > OPENED_M

    def update(self) -> None:
        """Notes the state after a step."""
        view = self._view
        self._released |= self._held and not view.holding
        self._held |= view.holding
        self._left |= not view.rests

    @property
    def over(self) -> bool:
        """Whether the skill has reached its end."""
        view, skill = self._view, self._stage.skill
        if not view.rests:
            return False
        if self._truth is not None:
            return achieved(self._task, self._stage, self._truth)
        if skill == "pick":
            return view.holding
        if skill == "place":
            return not view.holding
        if skill.startswith("open"):
            return self._held and not view.holding
        closed = not self._was_opened or self._handle_moved_m < CLOSED_M
        return self._left and not view.holding and closed

    @property
    def failed(self) -> bool:
        """Whether the robot knows that it picked a wrong object, which ends Pick's environment."""
        wrong = self._truth is not None and self._truth.holding and not self._has_target
        return self._stage.skill == "pick" and wrong

    def gripper(self, value: float) -> float:
        """Returns `GRASP` or `RELEASE` for a gripper entry, masked as in the skill's environment.

        What has been picked is not released, and nothing is grasped after the object was placed.
        """
        keeps, empties = False, False
        if self._stage.skill == "pick":
            keeps = self._has_target if self._truth is not None else self._view.holding
        elif self._stage.skill == "place":
            empties = self._released and (self._truth is None or self._is_placed)
        if empties:
            return RELEASE
        return GRASP if keeps or value >= 0 else RELEASE

    def after(self) -> float:
        """Returns the gripper entry after the skill: objects stay held, handles are released."""
        return GRASP if self._stage.handles_object and self._view.holding else RELEASE

    @property
    def _handle_moved_m(self) -> float:
        """Distance of the handle from its place at the start of the episode; 0 if unknown."""
        if self._stage.articulation is None:
            return 0.0
        return self._view.moved_m(self._stage.articulation) or 0.0

    @property
    def _has_target(self) -> bool:
        assert self._truth is not None
        return self._truth.holds(self._stage.object)

    @property
    def _is_placed(self) -> bool:
        assert self._truth is not None
        return achieved(self._task, self._stage, self._truth)
