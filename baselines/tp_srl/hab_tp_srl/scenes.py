"""Scenes of TP+SRL's robots: with the view of a task, and with ground truth or without."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.shapes import Array

from hab_tp_srl.view import TaskView


class GuidedScene(TrueScene):
    """Ground truth, for oracle navigation and planned skills, beside what learned skills observe.

    Attributes:
        view: What learned skills observe.
    """

    def __init__(self, view: TaskView) -> None:
        super().__init__()
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
        view: What learned skills observe.
    """

    def __init__(self, view: TaskView) -> None:
        self.view = view

    def forget(self) -> None:
        """Starts a new episode."""
        self.view.forget()

    def see(self, obs: Mapping[str, Any], row: int) -> None:
        """Processes the observation of a row."""
        self.view.see(obs, row)

    @property
    def arm_qpos(self) -> Array:
        """Joint positions of the arm (7,) [rad]."""
        return self.view.arm_qpos

    @property
    def world_from_base(self) -> Array:
        """(4, 4) pose of the base frame, which is its own world."""
        return np.eye(4)

    @property
    def holding(self) -> bool:
        """Whether the hand holds anything."""
        return self.view.holding

    def in_the_way(self, path: Array) -> bool:
        """Returns False: obstacles are not known."""
        return False

    def met(self, path: Array) -> None:
        """Does nothing: obstacles are not known."""
