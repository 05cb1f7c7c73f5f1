"""Delayed actions: timing, independent rows, refusals, save and restore."""

from types import SimpleNamespace

import pytest
import torch

from hab_tasks.errors import ActionError
from hab_tasks.robots.delay import ActionDelay

EMPTY = torch.tensor([False, False])


class Controller:
    """Two rows with actions of one number, none of them negative; holding is -1, idle -2."""

    scene = SimpleNamespace(num_envs=2)
    action_size, device = 1, torch.device("cpu")

    def check(self, action):
        if bool((action < 0).any()):
            raise ActionError("negative")

    def idle_action(self, holding):
        return torch.where(holding, -1.0, -2.0)[:, None]


def exchanged(waiting, *pairs, holding=EMPTY):
    """What is due in each row for actions asked for one after the other."""
    columns = (torch.tensor(pair, dtype=torch.float32)[:, None] for pair in pairs)
    return [waiting.exchange(column, holding)[:, 0].tolist() for column in columns]


def test_actions_are_due_n_steps_after_the_beginning_of_their_row():
    waiting = ActionDelay(2, Controller())
    assert exchanged(waiting, (1, 5), (2, 6), (3, 7)) == [[-2, -2], [-2, -2], [1, 5]]
    waiting.begin(torch.tensor([1]))  # its first row goes on
    assert exchanged(waiting, (4, 8), (9, 9), (9, 9)) == [[2, -2], [3, -2], [4, 8]]
    holding = torch.tensor([True, False])
    assert exchanged(ActionDelay(1, Controller()), (1, 5), holding=holding) == [[-1, -2]]


def test_a_bad_action_is_refused_when_it_is_asked_for_and_forgotten():
    waiting = ActionDelay(1, Controller())
    exchanged(waiting, (1, 5))
    with pytest.raises(ActionError):
        exchanged(waiting, (2, -6))
    assert exchanged(waiting, (3, 7), (4, 8)) == [[1, 5], [3, 7]]
