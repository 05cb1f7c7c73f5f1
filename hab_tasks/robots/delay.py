"""Delay of actions by a number of steps (S F.5)."""

from __future__ import annotations

import torch
from torch import Tensor

from hab_tasks.option_values import whole
from hab_tasks.robots.control import HabController

LONGEST_STEPS = 1000


def checked_steps(steps: int) -> int:
    """Validates a delay [steps].

    Raises:
        OptionError: Not an integer, negative, or longer than `LONGEST_STEPS`.
    """
    return whole("action_delay_steps", steps, 0, LONGEST_STEPS, "steps")


class ActionDelay:
    """Queue of the last n actions of each row."""

    def __init__(self, steps: int, controller: HabController) -> None:
        """Delays the actions of `controller` by `steps`, at least one."""
        self.steps, self._controller = steps, controller
        count, size = controller.scene.num_envs, controller.action_size
        self._queue = torch.zeros(count, steps, size, device=controller.device)
        self._filled = torch.zeros(count, dtype=torch.long, device=controller.device)

    def begin(self, rows: Tensor) -> None:
        """Clears the queues of the rows (R,)."""
        self._queue, self._filled = self._queue.clone(), self._filled.clone()
        self._queue[rows], self._filled[rows] = 0.0, 0

    def exchange(self, action: Tensor, holding: Tensor) -> Tensor:
        """Queues an action (N, A), and returns the one that is due.

        Args:
            action: Validated now, so that errors are raised by the step that passes it.
            holding: (N,) whether the hand holds an object or handle; the grasp is kept until the
                first action is due.

        Raises:
            ActionError: Wrong shape, a non-finite entry, or an invalid cell.
        """
        self._controller.check(action)
        idle = self._controller.idle_action(holding)
        due = torch.where((self._filled >= self.steps)[:, None], self._queue[:, 0], idle)
        latest = action.reshape(len(idle), 1, -1)
        self._queue = torch.cat((self._queue[:, 1:], latest), dim=1)
        self._filled = (self._filled + 1).clamp(max=self.steps)
        return due

    def get_state(self) -> dict[str, Tensor]:
        """Returns the queued actions (N, n, A) and their number (N,)."""
        return {"queue": self._queue.clone(), "filled": self._filled.clone()}

    def set_state(self, state: dict[str, Tensor], rows: Tensor) -> None:
        """Restores a state of `get_state` for `rows` (R,)."""
        self._queue, self._filled = self._queue.clone(), self._filled.clone()
        self._queue[rows], self._filled[rows] = state["queue"], state["filled"]
