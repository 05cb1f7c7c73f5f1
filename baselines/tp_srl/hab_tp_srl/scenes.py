"""Scenes of TP+SRL's robots: with the view of a task, and with ground truth or without."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from hab_plans.belief import Opening
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.shapes import Array

from hab_tasks.articulations import ArticulationKind
from hab_tasks.robots.spec import RobotSpec
from hab_tp_srl.view import TaskView


class GuidedScene(TrueScene):
    """Ground truth, for oracle navigation and planned skills, beside what learned skills observe.

    Attributes:
        view: What learned skills observe.
    """

    def __init__(self, robot: RobotSpec, view: TaskView) -> None:
        super().__init__(robot)
        self.view = view

    def forget(self) -> None:
        """Starts a new episode."""
        super().forget()
        self.view.forget()

    def see(self, obs: Mapping[str, Any], row: int) -> None:
        """Processes the observation of a row."""
        super().see(obs, row)
        self.view.see(obs, row)


class ObservedScene:
    """The part of `hab_spa.scenes.scene.Scene` that a robot without planned skills needs.

    Attributes:
        robot: The robot.
        view: What learned skills observe.
        place_error_m: How far off the place of an object may be: what lies at the edge of its goal
            is not taken for placed.
    """

    place_error_m = 0.02

    def __init__(self, robot: RobotSpec, view: TaskView) -> None:
        self.robot, self.view = robot, view

    def forget(self) -> None:
        """Starts a new episode."""
        self.view.forget()

    def see(self, obs: Mapping[str, Any], row: int) -> None:
        """Processes the observation of a row."""
        self.view.see(obs, row)

    @property
    def arm_qpos(self) -> Array:
        """Joint positions of the arm (J,) [rad]."""
        return self.view.arm_qpos

    @property
    def world_from_base(self) -> Array:
        """(4, 4) pose of the base frame, which is its own world."""
        return np.eye(4)

    @property
    def holding(self) -> bool:
        """Whether the hand holds anything."""
        return self.view.holding

    def holds(self, number: int) -> bool:
        """Whether the hand is believed to hold an object."""
        return self.view.felt.held == number

    def object_m(self, number: int) -> Array:
        """Returns the believed place (3,) of an object."""
        return self.view.felt.places_m[number]

    def goal_m(self, number: int) -> Array:
        """Returns the goal (3,) of an object."""
        return self.view.goal_m(number)

    def was_let_go(self, number: int) -> bool:
        """Whether an object lies where the hand let it go."""
        return bool(self.view.felt.moved[number])

    def opening(self, number: int, kind: ArticulationKind) -> Opening:
        """Returns whether a door or drawer is believed to be open."""
        return self.view.felt.openings[number]

    def in_the_way(self, path: Array) -> bool:
        """Returns False: obstacles are not known."""
        return False

    def met(self, path: Array) -> None:
        """Does nothing: obstacles are not known."""
