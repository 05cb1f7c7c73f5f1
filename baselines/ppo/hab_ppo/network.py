"""The actor-critic of S Figs. 9 and 24.

Images of all cameras are stacked on channels and pass the visual encoder, the state passes the
state encoder; both, normalised, go through an optional LSTM to the actor and the value head.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import torch
from gymnasium import spaces
from torch import Tensor, nn

from hab_ppo.actions import Noise, action_head
from hab_ppo.layers import RowEncoder, RowLinear, run_lstm
from hab_ppo.normalizer import RunningNormalizer
from hab_ppo.observation import Observation, ObservationLayout
from hab_ppo.recipe import NetworkConfig

HOLDING = ("agent", "is_holding")
"""Path of the observation that is positive while the gripper holds something."""

GREEDY_SHARE = 0.25
"""Share of the gripper's persistence that actions without noise leave out."""

CONVOLUTIONS = ((32, 8, 4), (64, 4, 2), (32, 3, 1))
"""Channels, width and stride of the visual encoder's layers: Habitat's SimpleCNN."""


class Chosen(NamedTuple):
    """What the policy does in N rows.

    Attributes:
        actions: (N, *stored).
        memory: (2, N, H) state of the LSTM afterwards; H is 0 without one.
    """

    actions: Tensor
    memory: Tensor


class Acted(NamedTuple):
    """What the policy does in N rows, with what learning needs to know of it.

    Attributes:
        actions: (N, *stored).
        log_probs: (N,).
        values: (N,).
        memory: (2, N, H) state of the LSTM afterwards; H is 0 without one.
    """

    actions: Tensor
    log_probs: Tensor
    values: Tensor
    memory: Tensor


class Judged(NamedTuple):
    """What the policy now thinks of a rollout; each (T, N), `outputs` (T, N, O) of the actor."""

    log_probs: Tensor
    entropies: Tensor
    values: Tensor
    outputs: Tensor


class Policy(nn.Module):
    """Actor and critic.

    Attributes:
        layout: The entries of the observation that it sees.
        config: Sizes.
    """

    def __init__(
        self,
        layout: ObservationLayout,
        action_space: spaces.Space[Any],
        config: NetworkConfig,
        binary: Sequence[int] = (),
    ) -> None:
        """Creates a policy; `binary` are the indices of the action's entries that are -1 or 1."""
        super().__init__()
        self.layout, self.config = layout, config
        self.state_normalizer = RunningNormalizer(layout.state_size)
        self.image_normalizer = self.image_encoder = None
        self.state_encoder = _layers((layout.state_size, *config.state_layers))
        width = (layout.state_size, *config.state_layers)[-1]
        if layout.image_shape is not None:
            self.image_normalizer = RunningNormalizer(layout.image_shape[0])
            self.image_encoder = _image_encoder(layout.image_shape, config.image_features)
            width += config.image_features
        self.lstm = nn.LSTM(width, config.lstm_size) if config.lstm_size else None
        width = config.lstm_size or width
        self.head = action_head(action_space, config.log_std, binary)
        self.actor = _head(width, config.head_layers, self.head.size, gain=0.01)
        self.critic = _head(width, config.head_layers, 1, gain=1.0)
        self._binary, self._holding = list(binary), layout.start_of(HOLDING)

    def no_memory(self, rows: int) -> Tensor:
        """Returns the LSTM's state (2, rows, H) at the start of an episode."""
        return torch.zeros(2, rows, self.config.lstm_size, device=self.state_normalizer.mean.device)

    def encoded(self, obs: Observation) -> Tensor:
        """Returns the encodings (M, F) of M observations."""
        encoding = self.state_encoder(self.state_normalizer(obs.state))
        if self.image_encoder is None or self.image_normalizer is None:
            return encoding
        assert obs.images is not None
        images = self.image_encoder(self.image_normalizer(obs.images))
        return torch.cat((images, encoding), dim=-1)

    def outputs(self, features: Tensor, obs: Observation) -> Tensor:
        """Returns the parameters (M, O) of the actions' distribution.

        Args:
            features: (M, F) what `features` returns for the observations.
            obs: The M observations.
        """
        return self.actor(features) + self._persistence(obs)

    def _persistence(self, obs: Observation) -> Tensor:
        """Returns the logits, or zeros (M, 1), by which the gripper tends to stay as it is."""
        if not self._binary or self._holding is None:
            return torch.zeros_like(obs.state[:, :1])
        closed = torch.where(obs.state[:, self._holding] > 0, 1.0, -1.0)
        stays = torch.zeros(len(closed), self.head.size, device=closed.device)
        stays[:, self._binary] = (self.config.gripper_persistence or 0.0) * closed[:, None]
        return stays

    @torch.no_grad()
    def choose(
        self, obs: Observation, memory: Tensor, starts: Tensor, noise: Noise | None = None
    ) -> Chosen:
        """Acts in N rows.

        Without noise it takes the most likely actions, but the gripper changes sooner: at 30 % a
        step, a drawn gripper changes soon, the most likely one never. For a persistence of 4 it
        changes above 27 %.

        Args:
            obs: Observations of the N rows.
            memory: (2, N, H) state of the LSTM.
            starts: (N,) bool, true where an episode starts.
            noise: Draws the actions; None for the most likely ones.
        """
        features, memory = self._step(obs, memory, starts)
        outputs = self.outputs(features, obs)
        if noise is None:
            outputs = outputs - GREEDY_SHARE * self._persistence(obs)
        return Chosen(self.head.sample(outputs, noise), memory)

    @torch.no_grad()
    def act(self, obs: Observation, memory: Tensor, starts: Tensor, noise: Noise) -> Acted:
        """Acts like `choose` with noise, and tells the log-probabilities and the values."""
        features, memory = self._step(obs, memory, starts)
        outputs = self.outputs(features, obs)
        actions = self.head.sample(outputs, noise)
        log_probs = self.head.log_prob(outputs, actions)
        return Acted(actions, log_probs, self.critic(features)[:, 0], memory)

    @torch.no_grad()
    def values(self, obs: Observation, memory: Tensor, starts: Tensor) -> Tensor:
        """Returns the values (N,) of the observations of N rows; arguments as in `choose`."""
        return self.critic(self._step(obs, memory, starts)[0])[:, 0]

    def _step(self, obs: Observation, memory: Tensor, starts: Tensor) -> tuple[Tensor, Tensor]:
        """Returns the inputs (N, F) of actor and critic, and the LSTM's state afterwards."""
        features = self.encoded(obs)
        if self.lstm is None:
            return features, memory
        hidden, cell = (memory * ~starts[:, None])[:, None].contiguous()
        features, (hidden, cell) = self.lstm(features[None], (hidden, cell))
        return features[0], torch.cat((hidden, cell))

    def judge(self, obs: Observation, actions: Tensor, starts: Tensor, memory: Tensor) -> Judged:
        """Returns what the policy thinks of a rollout of T steps in N rows, with gradients.

        Args:
            obs: Observations, flattened to T N rows.
            actions: (T, N, *stored).
            starts: (T, N) bool.
            memory: (2, N, H) state of the LSTM before the rollout.
        """
        shape = starts.shape
        features, _ = self.features(obs, starts, memory)
        outputs = self.outputs(features, obs)
        log_probs = self.head.log_prob(outputs, actions.flatten(0, 1))
        values = self.critic(features)[:, 0]
        entropies = self.head.entropy(outputs)
        return Judged(
            log_probs.view(shape),
            entropies.view(shape),
            values.view(shape),
            outputs.view(*shape, -1),
        )

    def features(self, obs: Observation, starts: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        """Returns the inputs (T N, F) of actor and critic, and the LSTM's state after a rollout.

        Args:
            obs: Observations, flattened to T N rows.
            starts: (T, N) bool.
            memory: (2, N, H) state of the LSTM before the rollout.
        """
        features = self.encoded(obs)
        if self.lstm is None:
            return features, memory
        inputs = features.view(*starts.shape, -1)
        outputs, memory = run_lstm(self.lstm, inputs, starts, memory)
        return outputs.flatten(0, 1), memory


def new_policy(
    layout: ObservationLayout,
    action_space: spaces.Space[Any],
    config: NetworkConfig,
    seed: int,
    binary: Sequence[int] = (),
) -> Policy:
    """Returns a policy with weights drawn from a seed; the global random state is kept."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return Policy(layout, action_space, config, binary)


def _layers(widths: Sequence[int]) -> nn.Sequential:
    """Returns hidden layers of these widths."""
    layers: list[nn.Module] = []
    for before, after in pairwise(widths):
        layers += [_orthogonal(RowLinear(before, after), math.sqrt(2)), nn.Tanh()]
    return nn.Sequential(*layers)


def _head(width: int, hidden: Sequence[int], size: int, *, gain: float) -> nn.Sequential:
    """Returns hidden layers and an output layer, which starts near zero for a small gain."""
    widths = (width, *hidden)
    return nn.Sequential(*_layers(widths), _orthogonal(RowLinear(widths[-1], size), gain))


def _image_encoder(shape: tuple[int, int, int], features: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    channels, height, width = shape
    for out, size, stride in CONVOLUTIONS:
        layers += [_orthogonal(nn.Conv2d(channels, out, size, stride), math.sqrt(2)), nn.ReLU()]
        height, width = ((side - size) // stride + 1 for side in (height, width))
        channels = out
    flat = _orthogonal(RowLinear(channels * height * width, features), math.sqrt(2))
    return RowEncoder(*layers, nn.Flatten(), flat, nn.ReLU())


def _orthogonal(layer: nn.Module, gain: float) -> nn.Module:
    nn.init.orthogonal_(layer.weight, gain)  # pyright: ignore[reportArgumentType]
    nn.init.zeros_(layer.bias)  # pyright: ignore[reportArgumentType]
    return layer
