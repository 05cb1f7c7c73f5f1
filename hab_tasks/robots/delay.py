"""Delay of actions by a number of steps (S F.5)."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from hab_tasks.arrays import Batch
from hab_tasks.robots.control import HabController

LONGEST_STEPS = 1000
"""Maximum of the option `action_delay_steps`."""


class ActionDelay:
    """Queue of the last n actions of one robot."""

    def __init__(self, steps: int, controller: HabController) -> None:
        """Delays the actions of `controller` by `steps`, at least one."""
        self.steps, self._controller = steps, controller
        self._queue: list[Batch] = []

    def begin(self) -> None:
        """Clears the queue."""
        self._queue = []

    def exchange(self, action: Batch, holding: bool) -> Batch:
        """Queues a valid action (A,), and returns the one that is due.

        Until the first action is due, the robot stands still and keeps its grasp: `holding` is
        whether the hand holds an object or handle.
        """
        self._queue.append(np.array(action))  # the caller may reuse its memory
        if len(self._queue) > self.steps:
            return self._queue.pop(0)
        return self._controller.idle_action(holding)

    def get_state(self) -> dict[str, Tensor]:
        """Returns the queued actions (1, n, A), the latest last, and their number (1,)."""
        queue = torch.zeros(1, self.steps, self._controller.action_size)
        for number, action in enumerate(self._queue):
            queue[0, self.steps - len(self._queue) + number] = torch.as_tensor(action)
        return {"queue": queue, "filled": torch.tensor([len(self._queue)])}

    def set_state(self, state: dict[str, Tensor]) -> None:
        """Restores a state of `get_state`."""
        filled = int(state["filled"][0])
        self._queue = list(state["queue"][0, self.steps - filled :].numpy().copy())
