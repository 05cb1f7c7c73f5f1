"""Delayed actions: timing, independent rows, save and restore."""

from types import SimpleNamespace

import pytest
import torch

from hab_tasks.errors import ActionError, OptionError
from hab_tasks.robots.delay import ActionDelay, checked_steps

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


def delay(steps):
    return ActionDelay(steps, Controller())


def column(*values):
    return torch.tensor(values, dtype=torch.float32)[:, None]


def exchanged(waiting, *pairs, holding=EMPTY):
    """What is due in each row for actions asked for one after the other."""
    return [waiting.exchange(column(*pair), holding)[:, 0].tolist() for pair in pairs]


def test_actions_are_due_n_steps_later():
    found = exchanged(delay(2), (1, 5), (2, 6), (3, 7), (4, 8))
    assert found == [[-2, -2], [-2, -2], [1, 5], [2, 6]]


def test_what_is_held_is_held_until_the_first_action_is_due():
    found = exchanged(delay(1), (1, 5), (2, 6), holding=torch.tensor([True, False]))
    assert found == [[-1, -2], [1, 5]]


def test_a_row_that_begins_anew_waits_again_and_the_other_goes_on():
    waiting = delay(2)
    exchanged(waiting, (1, 5), (2, 6), (3, 7))
    waiting.begin(torch.tensor([1]))
    assert exchanged(waiting, (4, 8), (9, 9), (9, 9)) == [[2, -2], [3, -2], [4, 8]]


def test_a_bad_action_is_refused_when_it_is_asked_for_and_forgotten():
    waiting = delay(1)
    exchanged(waiting, (1, 5))
    with pytest.raises(ActionError):
        exchanged(waiting, (2, -6))
    assert exchanged(waiting, (3, 7), (4, 8)) == [[1, 5], [3, 7]]


def test_a_restored_delay_goes_on_alike_in_the_rows_restored():
    first, second = delay(2), delay(2)
    exchanged(first, (1, 5), (2, 6))
    state = first.get_state()
    exchanged(first, (3, 7))
    assert state["queue"].flatten().tolist() == [1, 2, 5, 6]
    assert state["filled"].tolist() == [2, 2]
    rows = {name: value[:1] for name, value in state.items()}
    second.set_state(rows, torch.tensor([0]))
    assert exchanged(second, (3, 7), (4, 8)) == [[1, -2], [2, -2]]


def test_cells_are_kept_as_cells():
    waiting = delay(1)
    waiting.exchange(torch.tensor([3.0, 4.0]), EMPTY)
    assert waiting.exchange(torch.tensor([5.0, 6.0]), EMPTY).tolist() == [[3.0], [4.0]]


def test_delays_are_whole_numbers_of_steps():
    for steps in (-1, 1.5, "2", True, None):
        with pytest.raises(OptionError, match="whole number of steps from 0"):
            checked_steps(steps)
    assert checked_steps(0) == 0
