"""Cloning in the toy environment."""

import torch
from hab_ppo.cloning import clone, misfits
from hab_ppo.network import new_policy
from hab_ppo.observation import ObservationLayout
from hab_ppo.recipe import Cloning, NetworkConfig
from toy_examples import linear, random_examples
from toy_vector import ToyVector

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
    space = ToyVector(1, discrete=True).single_action_space
    policy = new_policy(LAYOUT, space, PLAIN, seed=0)
    examples = random_examples([20] * 30, lambda state: (state[:, 0] > 0).long() * 2)
    clone(policy, examples, Cloning(epochs=40, batch_steps=256), 0, QUIET)
    features, _ = policy.features(
        examples.observations(), examples.starts()[:, None], policy.no_memory(1)
    )
    right = policy.actor(features).argmax(dim=1) == examples.actions
    assert right.float().mean() > 0.95
