"""The loss against hand-worked values, and learning in a toy environment."""

import math
from types import SimpleNamespace

import pytest
import torch
from hab_ppo.actions import action_head
from hab_ppo.collect import Collector
from hab_ppo.distributed import Ranks
from hab_ppo.evaluation import evaluate
from hab_ppo.network import Judged, new_policy
from hab_ppo.observation import ObservationLayout
from hab_ppo.ppo import METRICS, PPO, Batch
from hab_ppo.recipe import FAST, NetworkConfig, PPOConfig
from hab_ppo.rollout import Rollout
from toy_vector import ToyVector, goals

TOY = ToyVector(1)
LAYOUT = ObservationLayout.of(TOY.single_observation_space)


def toy_learner(config=None, rows=8, steps=24, *, discrete=False, network=None):
    env = ToyVector(rows, discrete=discrete)
    network = network or NetworkConfig(head_layers=(32,), log_std=-0.5)
    policy = new_policy(LAYOUT, env.single_action_space, network, seed=1)
    ranks = Ranks()
    collector = Collector(env, policy, ranks, steps)
    collector.reset(list(range(rows)))
    return PPO(policy, config or FAST.ppo, ranks), collector


def test_loss():
    config = PPOConfig(value_weight=0.5, entropy_weight=0.1, clip=0.2)
    learner, _ = toy_learner(config)
    rollout = Rollout.empty(3, 1, LAYOUT, (1,), 0)
    rollout.valid[:2] = True  # the third step does not count
    judged = Judged(
        torch.tensor([[math.log(1.5)], [math.log(0.5)], [9.0]]),
        torch.tensor([[0.5], [0.5], [9.0]]),
        torch.tensor([[1.0], [2.0], [9.0]]),
        torch.zeros(3, 1, 1),
    )
    learner.policy = SimpleNamespace(judge=lambda *args: judged)
    batch = Batch(
        rollout=rollout,
        advantages=torch.tensor([[1.0], [-1.0], [0.0]]),
        returns=torch.tensor([[2.0], [0.0], [0.0]]),
    )
    loss, sums = learner._minibatch(batch, 2)
    # Gains: min(1.5, 1.2) = 1.2 and min(-0.5, -0.8) = -0.8, so the policy's loss is -0.4.
    # Value loss: (1 + 4) / 2 = 2.5. Entropy: 1. Loss: (-0.4 + 0.5 * 2.5 - 0.1 * 1) / 2 = 0.375.
    assert loss.item() == pytest.approx(0.375)
    found = dict(zip(METRICS, sums.tolist(), strict=True))
    assert found["policy_loss"] == pytest.approx(-0.4)
    assert found["value_loss"] == pytest.approx(2.5)
    assert found["entropy"] == pytest.approx(1.0)
    assert found["clipped"] == 2
    # r - 1 - ln r: 0.5 - 0.405465 + (-0.5 + 0.693147)
    assert found["kl"] == pytest.approx(0.287682, abs=1e-5)


def test_advantages_are_normalised_over_valid_steps_only():
    learner, collector = toy_learner()
    rollout, _ = collector.collect(0, torch.Generator().manual_seed(0))
    batch = learner._batch(rollout)
    assert not rollout.valid.all()
    assert batch.advantages[rollout.valid].mean().item() == pytest.approx(0, abs=1e-6)
    assert batch.advantages[rollout.valid].std(correction=0).item() == pytest.approx(1, abs=1e-5)
    assert not batch.advantages[~rollout.valid].any()


def test_rewards_are_scaled_by_the_deviation_of_the_discounted_return():
    learner, collector = toy_learner()
    rollout, _ = collector.collect(0, torch.Generator().manual_seed(0))
    before = rollout.rewards.clone()
    learner._batch(rollout)
    moments = learner.return_moments
    deviation = (moments.squares / moments.count).sqrt().item()
    torch.testing.assert_close(rollout.rewards * deviation, before, atol=1e-5, rtol=1e-4)
    assert moments.count == rollout.valid.sum()


def test_minibatches_hold_each_row_once_in_each_epoch():
    learner, _ = toy_learner(PPOConfig(epochs=2, minibatches=3))
    parts = learner._minibatches(8, torch.Generator().manual_seed(0))
    assert [len(part) for part in parts] == [3, 3, 2] * 2
    for epoch in (parts[:3], parts[3:]):
        assert sorted(torch.cat(epoch).tolist()) == list(range(8))


def test_gaussian_and_categorical_heads_agree_with_torch():
    generator = torch.Generator().manual_seed(0)
    outputs = torch.randn(6, 3, generator=generator)
    cells = action_head(ToyVector(1, discrete=True).single_action_space, 0.0)
    actions = cells.sample(outputs, generator)
    reference = torch.distributions.Categorical(logits=outputs)
    torch.testing.assert_close(cells.log_prob(outputs, actions), reference.log_prob(actions))
    torch.testing.assert_close(cells.entropy(outputs), reference.entropy())
    assert torch.equal(cells.sample(outputs, None), outputs.argmax(dim=1))
    walk = action_head(TOY.single_action_space, -0.3)
    actions = walk.sample(outputs[:, :1], generator)
    reference = torch.distributions.Normal(outputs[:, :1], math.exp(-0.3))
    torch.testing.assert_close(
        walk.log_prob(outputs[:, :1], actions), reference.log_prob(actions)[:, 0]
    )
    torch.testing.assert_close(walk.entropy(outputs[:, :1]), reference.entropy()[:, 0])
    assert walk.to_env(torch.tensor([[3.0], [-0.5]])).tolist() == [[1.0], [-0.5]]


@pytest.mark.parametrize("lstm_size", [0, 16], ids=["plain", "lstm"])
@pytest.mark.parametrize("discrete", [False, True], ids=["box", "discrete"])
def test_the_toy_is_learnt(discrete, lstm_size):
    network = NetworkConfig(lstm_size=lstm_size, head_layers=(32,), log_std=-0.5)
    learner, collector = toy_learner(rows=16, discrete=discrete, network=network)
    episodes = goals(20)
    for update in range(25):
        generator = torch.Generator().manual_seed(update)
        rollout, _ = collector.collect(update, generator)
        metrics = learner.update(rollout, generator, update / 40)
    assert all(math.isfinite(value) for value in metrics.values())
    assert metrics["learning_rate"] == pytest.approx(3e-4)
    scores = evaluate(collector.env, learner.policy, episodes)
    assert [score.episode for score in scores] == list(range(20))
    assert sum(score.success for score in scores) >= 18
