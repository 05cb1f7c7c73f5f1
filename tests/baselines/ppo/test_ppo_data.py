"""GAE, normalisers, observations and layers, against values worked out by hand."""

from collections import OrderedDict

import numpy as np
import pytest
import torch
from gymnasium import spaces
from hab_ppo.collect import Collector
from hab_ppo.distributed import Ranks
from hab_ppo.layers import RowLinear
from hab_ppo.network import new_policy
from hab_ppo.normalizer import Moments, RunningNormalizer
from hab_ppo.observation import ObservationLayout, averaged
from hab_ppo.recipe import NetworkConfig
from hab_ppo.rollout import Rollout, discounted_returns, gae
from torch.nn import functional
from toy_vector import ToyVector

from hab_tasks.errors import OptionError

LAYOUT = ObservationLayout.of(ToyVector(1).single_observation_space)


def rollout_of(rewards, values, last, *, terminated=(), truncated=(), dead=()):
    """A rollout of one row; the steps named are those of each flag."""
    rollout = Rollout.empty(len(rewards), 1, LAYOUT, (1,), 0)
    rollout.rewards[:, 0], rollout.values[:, 0] = torch.tensor(rewards), torch.tensor(values)
    rollout.last_values[0] = last
    rollout.valid[:] = True
    rollout.terminated[list(terminated)] = True
    rollout.truncated[list(truncated)] = True
    rollout.valid[list(dead)] = False
    return rollout


# Gamma = lambda = 0.5. Errors r + 0.5 V' - V of a row that never ends:
#   1 + 0.5 * 2 - 1 = 1;  2 + 0.5 * 3 - 2 = 1.5;  0 + 0.5 * 4 - 3 = -1;  4 + 0.5 * 2 - 4 = 1
# and each advantage is its error plus a quarter of the next advantage:
#   1;  -1 + 0.25 = -0.75;  1.5 - 0.1875 = 1.3125;  1 + 0.328125 = 1.328125
# Truncated in step 1: 3 is the value of the last state, and step 2, in which the row is reset,
# does not count: 1.5 and 1 + 0.375.
# Terminated in step 1: its error is 2 - 2 = 0.
def test_advantages():
    for flags, expected in (
        ({}, [1.328125, 1.3125, -0.75, 1.0]),
        ({"truncated": [1], "dead": [2]}, [1.375, 1.5, 0.0, 1.0]),
        ({"terminated": [1], "dead": [2]}, [1.0, 0.0, 0.0, 1.0]),
    ):
        rollout = rollout_of([1.0, 2.0, 0.0, 4.0], [1.0, 2.0, 3.0, 4.0], 2.0, **flags)
        assert gae(rollout, 0.5, 0.5)[:, 0].tolist() == expected, flags


def test_discounted_returns_start_anew_with_each_episode():
    rollout = rollout_of([1.0, 2.0, 0.0, 4.0], [0.0] * 4, 0.0)
    rollout.starts[3] = True
    # 0.5 * 8 + 1 = 5;  0.5 * 5 + 2 = 4.5;  2.25;  4
    assert discounted_returns(rollout, torch.tensor([8.0]), 0.5)[:, 0].tolist() == [5, 4.5, 2.25, 4]


def test_moments_merge_to_those_of_all_values():
    # 1 and 3: mean 2, squares 2. With 5: mean 3, squares 4 + 0 + 4 = 8.
    merged = Moments.of(torch.tensor([[1.0], [3.0]])).merged(Moments.of(torch.tensor([[5.0]])))
    assert (merged.count, merged.mean.item(), merged.squares.item()) == (3, 3, 8)
    values = torch.randn(100, 3, generator=torch.Generator().manual_seed(0)) * 1e3 + 1e6
    parts = (Moments.of(part) for part in (values[:1], values[:0], values[1:]))
    total = next(parts)
    for part in parts:
        total = total.merged(Moments.unpacked(part.packed()))
    torch.testing.assert_close(total.packed(), Moments.of(values).packed())


def test_normalizer_divides_each_channel_and_changes_only_when_told():
    normalizer = RunningNormalizer(2)
    values = torch.tensor([[1.0, 7.0], [3.0, 7.0]])
    assert torch.equal(normalizer(values), values)
    normalizer.learn(Moments.of(values))
    # Mean 2 and deviation 1; the second channel never changed, so it is only shifted.
    assert normalizer(values).tolist() == [[-1, 0], [1, 0]]
    images = torch.stack((torch.full((1, 4, 4), 3.0), torch.full((1, 4, 4), 8.0)), dim=1)
    assert normalizer(images)[0, :, 0, 0].tolist() == [1, 1]
    assert normalizer(torch.tensor([[1e6, 7.0]])).tolist() == [[10, 0]]
    assert normalizer.count == 2


def test_observations_are_read_in_the_order_of_their_paths():
    env = ToyVector(2, images=True)
    space = env.single_observation_space
    layout = ObservationLayout.of(space, image_block_px=3)
    back = spaces.Dict(OrderedDict(reversed([*space.items()])))
    assert ObservationLayout.of(back, image_block_px=3) == layout
    assert layout.state == (("agent", "position"), ("extra", "goal"))
    assert layout.image_shape == (4, 12, 12)
    obs = layout.read(env.reset(seed=[1, 2])[0])
    assert obs.state.shape == (2, 2)
    assert np.allclose(obs.state[:, 1], env.goal)
    assert obs.images is not None
    assert obs.images.shape == (2, 4, 12, 12)
    # The first camera of the space, the arm, comes first; colours and depth share a stack.
    first = layout.images.index(("sensor_data", "head", "depth"))
    assert np.allclose(obs.images[:, 3 if first else 0, 5, 5], env.goal)
    with pytest.raises(OptionError, match="image_block_px 5 does not divide images of 36 x 36"):
        ObservationLayout.of(space, image_block_px=5)


def test_blocks_of_pixels_are_averaged():
    # 2 x 2 blocks of rows (0 1 2 3), (4 5 6 7), ...: (0 + 1 + 4 + 5) / 4 = 2.5, (2 + 3 + 6 + 7) / 4
    # = 4.5; as whole numbers, torch rounds halves to even: 2 and 4.
    image = torch.arange(16.0).reshape(1, 1, 4, 4)
    assert averaged(image, 2).tolist() == [[[[2.5, 4.5], [10.5, 12.5]]]]
    assert averaged(image.to(torch.uint8), 2).tolist() == [[[[2, 4], [10, 12]]]]
    assert averaged(image, 1) is image


# All pairs of the three.
@pytest.mark.parametrize(
    ("lstm_size", "discrete", "images"),
    [(0, False, False), (0, True, True), (8, False, True), (8, True, False)],
)
def test_judging_a_rollout_repeats_what_was_thought_when_acting(lstm_size, discrete, images):
    env = ToyVector(5, discrete=discrete, images=images)
    layout = ObservationLayout.of(env.single_observation_space)
    config = NetworkConfig(lstm_size=lstm_size, head_layers=(16,), image_features=8)
    policy = new_policy(layout, env.single_action_space, config, seed=0)
    collector = Collector(env, policy, Ranks(), steps=30)
    collector.reset(list(range(5)))
    for update in range(2):  # the second continues the episodes of the first
        rollout, sums = collector.collect(update, torch.Generator().manual_seed(update))
        assert sums[0] == (rollout.terminated | rollout.truncated).sum() > 0
        assert sums[1] == rollout.terminated.sum()
        judged = policy.judge(
            rollout.observations(), rollout.actions, rollout.starts, rollout.memory
        )
        torch.testing.assert_close(judged.log_probs, rollout.log_probs, atol=1e-5, rtol=1e-5)
        torch.testing.assert_close(judged.values, rollout.values, atol=1e-5, rtol=1e-5)
        ended = (rollout.terminated | rollout.truncated)[:-1]
        assert torch.equal(ended, ~rollout.valid[1:])
        assert torch.equal(rollout.starts[1:], ~rollout.valid[:-1])
        assert not rollout.rewards[~rollout.valid].any()


def test_products_are_of_whole_groups_except_in_learning(monkeypatch):
    """So that what a row gets is independent of others."""
    products, linear = [], functional.linear

    def counted(values, weight, bias=None):
        products.append(len(values))
        return linear(values, weight, bias)

    monkeypatch.setattr(functional, "linear", counted)
    layer = RowLinear(5, 3)
    for rows in (1, 8, 9, 16):
        values = torch.randn(rows, 5)
        with torch.no_grad():
            out = layer(values)
        expected = values @ layer.weight.T + layer.bias
        torch.testing.assert_close(out, expected, atol=1e-6, rtol=0)
    layer(torch.randn(3, 5)).sum().backward()
    assert products == [8, 8, 16, 16, 3]
    assert layer.bias.grad.tolist() == [3.0, 3.0, 3.0]
