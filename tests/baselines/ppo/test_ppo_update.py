"""The loss against hand-worked values, and learning in a toy environment."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from gymnasium import spaces
from hab_ppo.actions import ActionNoise, action_head
from hab_ppo.collect import Collector
from hab_ppo.distributed import Ranks
from hab_ppo.network import HOLDING, Judged, new_policy
from hab_ppo.observation import Observation, ObservationLayout
from hab_ppo.ppo import METRICS, PPO, Batch
from hab_ppo.recipe import (
    FAST,
    PAPER,
    EnvConfig,
    FineTuning,
    NetworkConfig,
    PPOConfig,
    Recipe,
    WarmStart,
)
from hab_ppo.rollout import Rollout
from hab_ppo.rows import evaluate
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


def test_advantages_and_rewards_are_normalised_over_valid_steps():
    learner, collector = toy_learner()
    rollout, _ = collector.collect(0, torch.Generator().manual_seed(0))
    before, valid = rollout.rewards.clone(), rollout.valid
    advantages = learner._batch(rollout).advantages
    assert not valid.all()
    assert advantages[valid].mean().item() == pytest.approx(0, abs=1e-6)
    assert advantages[valid].std(correction=0).item() == pytest.approx(1, abs=1e-5)
    assert not advantages[~valid].any()
    moments = learner.return_moments  # of the discounted return
    deviation = (moments.squares / moments.count).sqrt().item()
    torch.testing.assert_close(rollout.rewards * deviation, before, atol=1e-5, rtol=1e-4)
    assert moments.count == valid.sum()


def test_gaussian_and_categorical_heads_agree_with_torch():
    generator = torch.Generator().manual_seed(0)
    outputs = torch.randn(6, 3, generator=generator)
    cells = action_head(ToyVector(1, discrete=True).single_action_space, 0.0)
    walk, normal = action_head(TOY.single_action_space, -0.3), torch.distributions.Normal
    for head, given, reference in (
        (cells, outputs, torch.distributions.Categorical(logits=outputs)),
        (walk, outputs[:, :1], normal(outputs[:, :1], math.exp(-0.3))),
    ):
        actions = head.sample(given, ActionNoise(generator))
        wanted = reference.log_prob(actions).reshape(6)
        torch.testing.assert_close(head.log_prob(given, actions), wanted)
        torch.testing.assert_close(head.entropy(given), reference.entropy().reshape(6))
    assert torch.equal(cells.sample(outputs, None), outputs.argmax(dim=1))
    assert walk.to_env(torch.tensor([[3.0], [-0.5]])).tolist() == [[1.0], [-0.5]]


def test_kl():
    walk = action_head(TOY.single_action_space, 0.0)
    reference = action_head(TOY.single_action_space, math.log(0.5))
    # ln(1 / 0.5) + (0.25 + 1) / 2 - 0.5 = 0.693147 + 0.125
    kl = walk.kl(torch.zeros(1, 1), reference, torch.ones(1, 1))
    assert kl.tolist() == pytest.approx([math.log(2) + 0.125])
    cells = action_head(ToyVector(1, discrete=True).single_action_space, 0.0)
    own, other = torch.tensor([[0.25, 0.25, 0.5]]).log(), torch.tensor([[0.5, 0.25, 0.25]]).log()
    # 0.5 ln 2 + 0 + 0.25 ln 0.5 = 0.25 ln 2
    assert cells.kl(own, cells, other).tolist() == pytest.approx([0.25 * math.log(2)])


def test_a_fixed_spread_falls_and_is_not_learnt():
    config = replace(FAST.ppo, final_log_std=-2.0)
    preset = replace(FAST, network=NetworkConfig(log_std=-0.5), ppo=config)
    env = EnvConfig(env="HabPick-v1", control_mode="ee")
    recipe = Recipe(name="toy", about="A toy.", env=env, preset=preset)
    # -0.5 + 0.5 * (-2 + 0.5) = -1.25; after the end, the last value.
    assert [recipe.log_std(share) for share in (0.0, 0.5, 1.0, 1.1)] == [-0.5, -1.25, -2.0, -2.0]
    cloned = replace(recipe, warm_start=WarmStart(tuning=FineTuning(log_std=-1.0)))
    assert cloned.log_std(0.5) == -1.5
    assert replace(recipe, preset=PAPER).log_std(0.5) is None
    for own, fixed in ((config, True), (replace(config, final_log_std=None), False)):
        learner, collector = toy_learner(own)
        learner.policy.head.explore(-1.25)
        rollout, _ = collector.collect(0, torch.Generator().manual_seed(0))
        learner.update(rollout, torch.Generator().manual_seed(0), 0.0)
        assert (learner.policy.head.log_std.tolist() == [-1.25]) == fixed


def test_a_binary_entry_beside_a_gaussian():
    space = spaces.Box(-1.0, 1.0, (2,), np.float32)
    head = action_head(space, 0.0, binary=(1,))
    outputs, actions = torch.tensor([[0.3, 2.0]]), torch.tensor([[0.8, 1.0]])
    assert head.sample(outputs, None).tolist() == [[pytest.approx(0.3), 1.0]]
    assert head.sample(-outputs, None).tolist() == [[pytest.approx(-0.3), -1.0]]
    # -0.5^2 / 2 - ln(2 pi) / 2 = -1.0439; ln sigmoid(2) = -0.1269
    assert head.log_prob(outputs, actions).tolist() == pytest.approx([-1.1709], abs=1e-4)
    # (1 + ln(2 pi)) / 2 = 1.4189; p = 0.8808: -0.8808 ln 0.8808 - 0.1192 ln 0.1192 = 0.3653
    assert head.entropy(outputs).tolist() == pytest.approx([1.7842], abs=1e-4)
    # (0.2^2 + 2.1269) / 2, as -ln sigmoid(-2) = 2.1269
    misfit = head.misfit(outputs, torch.tensor([[0.5, -1.0]]))
    assert misfit.tolist() == pytest.approx([1.0835], abs=1e-4)
    # 0.5 ln(0.5 / 0.8808) + 0.5 ln(0.5 / 0.1192) = 0.4338
    kl = head.kl(outputs, head, torch.tensor([[0.3, 0.0]]))
    assert kl.tolist() == pytest.approx([0.4338], abs=1e-4)
    drawn = head.sample(outputs.expand(20_000, 2), ActionNoise(torch.Generator().manual_seed(0)))
    assert set(drawn[:, 1].tolist()) == {-1.0, 1.0}
    assert (drawn[:, 1] > 0).float().mean().item() == pytest.approx(0.8808, abs=0.01)
    assert drawn[:, 0].std().item() == pytest.approx(1.0, abs=0.02)


def test_the_gripper_tends_to_stay_as_it_is():
    layout = ObservationLayout(state=(("agent", "arm_qpos"), HOLDING), state_sizes=(2, 1))
    space = spaces.Box(-1.0, 1.0, (4,), np.float32)
    config = NetworkConfig(head_layers=(16,), gripper_persistence=4.0)
    policy = new_policy(layout, space, config, 0, binary=(3,))
    obs = Observation(torch.tensor([[0.5, 0.1, 1.0], [0.5, 0.1, 0.0]]), None)
    features, memory = policy.encoded(obs), policy.no_memory(2)
    starts = torch.ones(2, dtype=torch.bool)
    change = policy.outputs(features, obs) - policy.actor(features)
    assert change.tolist() == [[0, 0, 0, pytest.approx(4)], [0, 0, 0, pytest.approx(-4)]]
    # Without noise, three quarters of the tendency to stay are left.
    for own, changes in ((2.9, False), (3.1, True)):
        with torch.no_grad():
            policy.actor[-1].weight.zero_()
            policy.actor[-1].bias[3] = -own
        assert (policy.choose(obs, memory, starts).actions[0, 3] < 0) == changes


def test_correlated_noise():
    like, white = torch.zeros(5, 2), ActionNoise(torch.Generator().manual_seed(3))
    coloured = ActionNoise(torch.Generator().manual_seed(3), correlation=0.6)
    first, second = white.normal(like), white.normal(like)
    assert torch.equal(coloured.normal(like), first)
    # sqrt(1 - 0.6^2) = 0.8
    torch.testing.assert_close(coloured.normal(like), 0.6 * first + 0.8 * second)


@pytest.mark.parametrize(("discrete", "lstm_size"), [(False, 16), (True, 0)])
def test_the_toy_is_learnt(discrete, lstm_size):
    network = NetworkConfig(lstm_size=lstm_size, head_layers=(32,), log_std=-0.5)
    learner, collector = toy_learner(rows=16, discrete=discrete, network=network)
    for update in range(25):
        generator = torch.Generator().manual_seed(update)
        rollout, _ = collector.collect(update, generator)
        metrics = learner.update(rollout, generator, update / 100)
    assert all(math.isfinite(value) for value in metrics.values())
    assert metrics["learning_rate"] == pytest.approx(0.76 * 3e-4)  # after 24 of 100 updates
    scores = evaluate(collector.env, learner.policy, goals(20))
    assert (len(scores), sum(score.success for score in scores) >= 18) == (20, True)
