"""Cloning, fine-tuning and distillation in the toy environment."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from hab_ppo.actions import action_head
from hab_ppo.agent import LoadedPolicy
from hab_ppo.cloning import clone, misfits
from hab_ppo.collect import Collector
from hab_ppo.distillation import PolicyTeacher, classroom, distill, visit
from hab_ppo.distributed import Ranks
from hab_ppo.network import Chosen, new_policy
from hab_ppo.observation import ObservationLayout
from hab_ppo.ppo import PPO, Guide, Stage
from hab_ppo.recipe import (
    FAST,
    Cloning,
    Distillation,
    EnvConfig,
    FineTuning,
    NetworkConfig,
    RecipeError,
)
from hab_ppo.rows import evaluate
from toy_examples import TOY, linear, random_examples
from toy_vector import ToyVector, goals

SPACE = ToyVector(1).single_action_space
LAYOUT = ObservationLayout.of(ToyVector(1).single_observation_space)
PLAIN = NetworkConfig(head_layers=(32,), log_std=-1.2)
LSTM = NetworkConfig(lstm_size=16, head_layers=(), log_std=-1.2)
QUIET = [].append


def previous(state):
    """What the state before was: only a network with memory can tell."""
    return torch.cat((torch.zeros(1, 1), state[:-1, :1]))


def test_cloning_recovers_a_linear_teacher():
    policy = new_policy(LAYOUT, SPACE, PLAIN, seed=0)
    config = Cloning(epochs=60, batch_steps=256)
    fit = clone(policy, random_examples([20] * 50, linear), config, 0, QUIET)
    assert fit.held_out_loss < 1e-3
    assert misfits(policy, random_examples([100], linear, seed=1)).mean() < 1e-3
    assert policy.state_normalizer.count == 1000


def test_an_lstm_is_fitted_to_whole_episodes():
    examples = random_examples([6, 4, 8, 5] * 20, previous)
    config = Cloning(epochs=50, learning_rate=1e-2, batch_steps=100)
    policy = new_policy(LAYOUT, SPACE, LSTM, seed=0)
    fit = clone(policy, examples, config, 0, QUIET)
    variance = float(examples.actions.var())
    assert fit.held_out_loss < 0.1 * variance
    # Episodes in a batch do not see each other.
    both = examples.episodes(torch.tensor([0, 1]))
    alone = examples.episodes(torch.tensor([1]))
    torch.testing.assert_close(misfits(policy, both)[6:], misfits(policy, alone))


def test_cells_are_cloned_by_cross_entropy():
    policy = new_policy(LAYOUT, ToyVector(1, discrete=True).single_action_space, PLAIN, seed=0)
    examples = random_examples([20] * 30, lambda state: (state[:, 0] > 0).long() * 2)
    clone(policy, examples, Cloning(epochs=40, batch_steps=256), 0, QUIET)
    starts, memory = examples.starts()[:, None], policy.no_memory(1)
    features, _ = policy.features(examples.observations(), starts, memory)
    right = policy.actor(features).argmax(dim=1) == examples.actions
    assert right.float().mean() > 0.95


def learner_of(network):
    policy = new_policy(LAYOUT, SPACE, network, seed=1)
    learner = PPO(policy, FAST.ppo, Ranks(), Guide(policy, FineTuning()))
    collector = Collector(ToyVector(8), policy, Ranks(), 24)
    collector.reset(list(range(8)))
    return learner, collector


@pytest.mark.parametrize("network", [PLAIN, LSTM], ids=["plain", "lstm"])
def test_the_critic_warms_up_alone(network):
    learner, collector = learner_of(network)
    before = {name: value.clone() for name, value in learner.policy.state_dict().items()}
    generator = torch.Generator().manual_seed(0)
    rollout, _ = collector.collect(0, generator)
    metrics = learner.update(rollout, generator, 0.0, Stage(critic_only=True))
    for name, value in learner.policy.state_dict().items():
        assert torch.equal(value, before[name]) != name.startswith("critic."), name
    assert metrics["start_kl"] == pytest.approx(0, abs=1e-6)


def test_the_kl_term_keeps_the_policy_near_its_start():
    found = {}
    for weight in (0.0, 100.0):
        learner, collector = learner_of(PLAIN)
        for update in range(6):
            generator = torch.Generator().manual_seed(update)
            rollout, _ = collector.collect(update, generator)
            metrics = learner.update(rollout, generator, 0.0, Stage(kl_weight=weight))
        found[weight] = metrics["start_kl"]
    assert 0 <= found[100.0] < 0.1 * found[0.0]


class Walker:
    """A teacher that walks to the goal as fast as it can."""

    layout = LAYOUT
    head = action_head(SPACE, 0.0)

    def no_memory(self, rows):
        return torch.zeros(2, rows, 0)

    def choose(self, obs, memory, starts, noise=None):
        gap = obs.state[:, 1:] - obs.state[:, :1]
        return Chosen((gap / 0.2).clamp(-1, 1), memory)


class Stubborn(Walker):
    """A student that always walks to the right."""

    state_normalizer = SimpleNamespace(mean=torch.zeros(1))

    def choose(self, obs, memory, starts, noise=None):
        return Chosen(torch.ones(len(obs.state), 1), memory)


def test_the_states_that_the_student_visits_get_the_labels_of_the_teacher():
    visits = visit(Stubborn(), PolicyTeacher(Walker(), 4), ToyVector(4), 60, 0.0, [0])
    assert 60 <= sum(len(part.state) for part in visits.parts) < 64
    for part in visits.parts:
        # 0.2 further right in each step, whatever the goal.
        assert np.allclose(part.state[:, 0], 0.2 * np.arange(len(part.state)), atol=1e-5)
        gap = part.state[:, 1:] - part.state[:, :1]
        torch.testing.assert_close(part.actions, (gap / 0.2).clamp(-1, 1))
    assert visits.episodes > visits.successes
    led = visit(Stubborn(), PolicyTeacher(Walker(), 4), ToyVector(4), 60, 1.0, [0])
    assert led.episodes == led.successes > 0


@pytest.mark.parametrize("images", [False, True], ids=["blind", "images"])
def test_a_student_is_distilled(images):
    env = ToyVector(8, images=images)
    layout = ObservationLayout.of(env.single_observation_space)
    student = new_policy(layout, SPACE, replace(PLAIN, image_features=8), seed=0)
    cloning = Cloning(epochs=4 if images else 30, batch_steps=64)
    config = Distillation(teacher="", rounds=3, round_steps=300, cloning=cloning)
    distill(student, PolicyTeacher(Walker(), env.num_envs), env, config, 0, Ranks(), QUIET)
    env.reset(seed=list(range(8)))
    scores = evaluate(env, student, goals(20))
    assert sum(score.success for score in scores) >= 16


def test_a_teacher_sees_a_handle_that_the_student_has_to_find():
    blind = EnvConfig(env="HabOpenDrawer-v1", control_mode="ee", handle_position=True)
    depth = replace(blind, obs_mode="depth", handle_position=False)
    teacher = LoadedPolicy(Walker(), replace(TOY, env=blind))
    assert classroom(depth, teacher) == replace(depth, handle_position=True)
    with pytest.raises(RecipeError, match="observes depth, the student state_dict"):
        classroom(blind, LoadedPolicy(Walker(), replace(TOY, env=depth)))
