"""Repeating a cycle of actions is not rewarded."""

import logging
import os

import numpy as np
import pytest
from cycling import climb, starts
from playing import ee_action, held, move_base

from hab_tasks.envs import ENVS

LOG = logging.getLogger(__name__)
EVALUATIONS = int(os.environ.get("HAB_CYCLE_EVALUATIONS", "20"))
PAPER_PAYS = {"HabPlace-v1": 0.5}
"""Most per step where the paper's equation pays a cycle: Place, which does not end on a drop."""

LIFT_M = 0.15
"""Lower than the resting position, which would end Pick."""


def pick_starts(env):
    """Puts the robot where the task's navigation ends; the next action is part of Pick."""
    env.reset(options={"episode": 0})
    base = env.unwrapped
    state = base.get_state_dict()
    move_base(state, env, *base.simulation.goals.base[0].tolist())
    base.set_state_dict(state)
    env.step(ee_action(env, np.zeros(3), -1.0))
    assert base.rules.progress.part.tolist() == [0]


def test_lifting_and_dropping_an_object_again_and_again_pays_nothing(make):
    env = make("HabTidyHouse-v1", control_mode="ee_base", obs_mode="state")
    pick_starts(env)
    base, totals, total, phase, steps = env.unwrapped, [], 0.0, "down", 0
    while len(totals) < 4 and steps < 1200:
        snapshot = base.simulation.snapshot
        way = snapshot.objects_m[0, 0] - snapshot.ee_m[0]
        if phase == "down":
            action, up = (np.clip(way / 0.015, -1, 1), 1.0), snapshot.ee_m[0, 2] + LIFT_M
            phase = "up" if held(env) else "down"
        elif phase == "up":
            action = (np.array([0.0, 0.0, 1.0]), 1.0)
            phase = "drop" if snapshot.ee_m[0, 2] > up - 0.02 else "up"
        else:
            action, phase = (np.zeros(3), -1.0), "down"
        _, reward, *_ = env.step(ee_action(env, *action))
        total, steps = total + float(reward[0]), steps + 1
        if phase == "down" and action[1] < 0:
            totals.append(total)
            total = 0.0
    assert len(totals) == 4, totals
    # The first began far from the object. Each costs at least the drop's penalty of 5, but for how
    # much closer to the object the hand is at its end.
    assert max(totals[1:]) < -4.0, totals
    assert base.rules.progress.part.tolist() == [1]


@pytest.mark.long
@pytest.mark.parametrize("env_id", ENVS)
def test_a_hill_climber_finds_no_loop_of_actions_that_is_rewarded(env_id):
    for name, w in starts(env_id, episode=0):
        state = w.raw.get_state_dict()
        for grasps in (False, True):
            rng = np.random.default_rng(0)
            most, _ = climb(w, state, EVALUATIONS, rng, grasps=grasps)
            LOG.info("%s, %s, grasps %s: %.2g a step", env_id, name, grasps, most)
            assert most < PAPER_PAYS.get(env_id, 1e-5), (name, grasps)
