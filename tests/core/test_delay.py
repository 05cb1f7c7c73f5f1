"""Delayed actions: timing, save and restore."""

import numpy as np

from hab_tasks.robots.control import ActionDelay


class Controller:
    """Actions of one number; the idle one is -1 while something is held, else -2."""

    action_size = 1

    def idle_action(self, holding):
        return np.array([-1.0 if holding else -2.0])


def exchanged(waiting, *actions, holding=False):
    """What is due for actions asked for one after the other."""
    return [float(waiting.exchange(np.array([action]), holding)[0]) for action in actions]


def test_actions_are_due_n_steps_after_the_beginning_of_their_episode():
    waiting = ActionDelay(2, Controller())
    assert exchanged(waiting, 1, 2, 3) == [-2, -2, 1]
    state = waiting.get_state()
    assert exchanged(waiting, 4, 5) == [2, 3]
    waiting.begin()
    assert exchanged(waiting, 6, 7, 8) == [-2, -2, 6]
    waiting.set_state(state)
    assert exchanged(waiting, 4, 5) == [2, 3]
    assert exchanged(ActionDelay(1, Controller()), 1, 2, holding=True) == [-1, 1]
