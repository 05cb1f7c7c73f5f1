"""Practice: the states that a clone visits get the labels of the demonstrated paths."""

import numpy as np
import torch
from gymnasium import spaces
from hab_ppo.network import new_policy
from hab_ppo.observation import ObservationLayout
from hab_ppo.practice import Lesson, practise
from hab_ppo.recipe import NetworkConfig
from hab_ppo.replay import SETTLING_STEPS
from hab_ppo.retiming import GRASP_STEPS, Stretch, spaced

STEP_M, LIMIT = 0.015, 60


class HandToy:
    """A hand that moves 1.5 cm a step; success within 3 cm of a goal, truncated at LIMIT."""

    def __init__(self, rows):
        self.num_envs = rows
        box = spaces.Box(-np.inf, np.inf, (3,), np.float32)
        holding = spaces.Box(0, 1, (1,), np.float32)
        agent = spaces.Dict({"ee_position": box, "is_holding": holding})
        self.single_observation_space = spaces.Dict({"agent": agent})
        self.single_action_space = spaces.Box(-1, 1, (4,), np.float32)
        self.ee_m, self.goals = np.zeros((rows, 3)), [None] * rows
        self.steps = np.zeros(rows, dtype=int)
        self.played = []

    def reset(self, *, options):
        for row in np.flatnonzero(options.get("reset_mask", np.ones(self.num_envs, bool))):
            self.goals[row] = options["episode"][row]
            self.ee_m[row], self.steps[row] = 0.0, 0
            self.played.append(self.goals[row])
        return self._obs(), {}

    def step(self, actions):
        self.ee_m = self.ee_m + STEP_M * np.clip(actions[:, :3], -1, 1)
        self.steps += 1
        gaps_m = np.linalg.norm(self.ee_m - np.array(self.goals), axis=1)
        success = gaps_m < 0.03
        reward, truncated = np.zeros(self.num_envs), (self.steps >= LIMIT) & ~success
        return self._obs(), reward, success, truncated, {"success": success}

    def _obs(self):
        holding = np.zeros((self.num_envs, 1), np.float32)
        return {"agent": {"ee_position": self.ee_m.astype(np.float32), "is_holding": holding}}


def lesson(goal, gripper=-1.0):
    points_m = spaced(np.array([[0.0, 0.0, 0.0], goal]))
    return Lesson(goal, [Stretch(points_m=points_m, gripper=gripper)])


def student(env, action):
    """A policy that always does the same."""
    layout = ObservationLayout.of(env.single_observation_space)
    policy = new_policy(layout, env.single_action_space, NetworkConfig(log_std=-9.0), 0)
    with torch.no_grad():
        policy.actor[-1].weight.zero_()
        policy.actor[-1].bias.copy_(torch.tensor(action))
    return policy


def test_each_lesson_is_played_once_and_labelled_by_its_path():
    lessons = [lesson((0.3, 0.0, 0.0)), lesson((0.0, 0.3, 0.0)), lesson((0.3, 0.3, 0.0))]
    env = HandToy(2)
    visits = practise(student(env, [1.0, 0.0, 0.0, -1.0]), lessons, env, [0])
    assert (visits.episodes, visits.successes) == (3, 1)  # the hand always goes along x
    assert set(env.played) == {one.episode for one in lessons}
    by_goal = {tuple(np.round(part.actions[0, :3].tolist(), 1)): part for part in visits.parts}
    assert len(by_goal[1.0, 0.0, 0.0].state) == 19  # 0.27 m are 18 steps; then within 3 cm
    beside = by_goal[0.0, 1.0, 0.0]
    # The hand is off to the right of the path, and the label leads back to it.
    assert (beside.actions[5:40, 0] < 0).all()
    assert (beside.actions[:, 3] == -1).all()


def test_a_path_that_is_over_or_lost_labels_nothing_more():
    short = Lesson((0.4, 0.0, 0.0), lesson((0.0, 0.0, 0.005)).path)
    lost = lesson((0.4, 0.0, 0.0), gripper=1.0)
    # The short path ends in the first step, which is one of those for settling.
    for one, steps in ((short, SETTLING_STEPS), (lost, GRASP_STEPS)):
        env = HandToy(1)
        (part,) = practise(student(env, [0.0, 0.0, 0.0, -1.0]), [one], env, [0]).parts
        assert len(part.state) == steps
