"""PPO from a policy that can do something already: critic warm-up, and a KL term that decays.

At first only the value head learns; a network with a trunk for both (an LSTM or an encoder) is
frozen but for it. Afterwards the loss has a term that keeps the policy near the one from which it
started. The normalisers stay as they were fitted, so that nothing shifts under the actor.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import torch
from torch import Tensor

from hab_ppo.actions import ActionHead
from hab_ppo.network import Policy
from hab_ppo.recipe import FineTuning
from hab_ppo.rollout import Rollout


@dataclass(frozen=True, kw_only=True)
class Stage:
    """How an update learns.

    Attributes:
        critic_only: Whether only the value head does.
        kl_weight: Weight of KL(start || policy).
    """

    critic_only: bool = False
    kl_weight: float = 0.0


class Guide:
    """The policy from which fine-tuning started.

    Attributes:
        head: Its distribution of actions.
    """

    def __init__(self, start: Policy, config: FineTuning) -> None:
        """Copies the policy `start`."""
        self._policy, self._config = copy.deepcopy(start).requires_grad_(False), config
        self.head: ActionHead = self._policy.head
        self._memory: Tensor | None = None

    def stage(self, update: int, steps: int) -> Stage:
        """Returns how to learn after so many updates and environment steps."""
        config = self._config
        if update < config.critic_updates:
            return Stage(critic_only=True)
        left = max(0.0, 1 - steps / max(1, config.kl_steps))
        return Stage(kl_weight=config.kl_weight * left)

    def forget(self) -> None:
        """Starts with an empty memory, as all rows start new episodes."""
        self._memory = None

    @torch.no_grad()
    def outputs(self, rollout: Rollout) -> Tensor:
        """Returns the actor's outputs (T, N, O) in a rollout that follows the last one."""
        rows = rollout.starts.shape[1]
        memory = self._policy.no_memory(rows) if self._memory is None else self._memory
        obs = rollout.observations()
        features, self._memory = self._policy.features(obs, rollout.starts, memory)
        return self._policy.outputs(features, obs).view(*rollout.starts.shape, -1)
