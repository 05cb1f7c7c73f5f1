"""Actions that are carried out some steps after they were asked for (S F.5)."""

from __future__ import annotations

import torch
from torch import Tensor

from hab_tasks.option_values import whole
from hab_tasks.robots.control import HabController

LONGEST_STEPS = 1000


def checked_steps(steps: int) -> int:
    """Returns a delay [steps], or refuses it.

    Raises:
        OptionError: Not a whole number, negative, or longer than `LONGEST_STEPS`.
    """
    return whole("action_delay_steps", steps, 0, LONGEST_STEPS, "steps")


class ActionDelay:
    """Keeps the last n actions of each row."""

    def __init__(self, steps: int, controller: HabController) -> None:
        """Delays the actions of `controller` by `steps`, one at least."""
        self.steps, self._controller = steps, controller
        count, size = controller.scene.num_envs, controller.action_size
        self._queue = torch.zeros(count, steps, size, device=controller.device)
        self._filled = torch.zeros(count, dtype=torch.long, device=controller.device)

    def begin(self, rows: Tensor) -> None:
        """Forgets what the rows (R,) were asked for."""
        self._queue, self._filled = self._queue.clone(), self._filled.clone()
        self._queue[rows], self._filled[rows] = 0.0, 0

    def exchange(self, action: Tensor, holding: Tensor) -> Tensor:
        """Takes an action (N, A), and returns the one that is due.

        Args:
            action: Checked at once, so that a bad one is refused when it is asked for.
            holding: (N,) whether the hand holds anything; before the first action is due, it goes
                on to do so.

        Raises:
            ActionError: Wrong shape, or an entry that is not finite or no cell.
        """
        self._controller.check(action)
        idle = self._controller.idle_action(holding)
        due = torch.where((self._filled >= self.steps)[:, None], self._queue[:, 0], idle)
        latest = action.reshape(len(idle), 1, -1)
        self._queue = torch.cat((self._queue[:, 1:], latest), dim=1)
        self._filled = (self._filled + 1).clamp(max=self.steps)
        return due

    def get_state(self) -> dict[str, Tensor]:
        """Returns the waiting actions (N, n, A), and how many of them there are (N,)."""
        return {"queue": self._queue.clone(), "filled": self._filled.clone()}

    def set_state(self, state: dict[str, Tensor], rows: Tensor) -> None:
        """Restores what `get_state` returned, for `rows` (R,)."""
        self._queue, self._filled = self._queue.clone(), self._filled.clone()
        self._queue[rows], self._filled[rows] = state["queue"], state["filled"]
