"""Proximal policy optimisation (arXiv 1707.06347), on all ranks together.

Sums over the steps of all ranks are divided by their number, so the gradients equal those of one
process with the data of all ranks.

Fine-tuning starts from a policy that can do something already. At first only the value head
learns; a network with a trunk for both (an LSTM or an encoder) is frozen but for it. Afterwards
the loss has a term that keeps the policy near the one from which it started. The normalisers stay
as they were fitted, so that nothing shifts under the actor.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from hab_ppo.actions import ActionHead
from hab_ppo.distributed import Ranks
from hab_ppo.network import Judged, Policy
from hab_ppo.normalizer import Moments, RunningNormalizer
from hab_ppo.recipe import FineTuning, PPOConfig
from hab_ppo.rollout import Rollout, discounted_returns, gae


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


METRICS = ("policy_loss", "value_loss", "entropy", "clipped", "kl", "start_kl")
"""Means over the steps of an update, in the order of `minibatch_sums`."""

EVERYTHING = Stage()


@dataclass(frozen=True, kw_only=True)
class Batch:
    """A rollout with the targets of the losses.

    Attributes:
        rollout: The rollout.
        advantages: (T, N), with mean 0 and standard deviation 1 over the valid steps of all ranks.
        returns: (T, N) targets of the value head.
        guide: (T, N, O) outputs of the actor from which fine-tuning started; None without one.
    """

    rollout: Rollout
    advantages: Tensor
    returns: Tensor
    guide: Tensor | None = None

    def of_rows(self, rows: Tensor) -> Batch:
        """Returns the batch of some rows."""
        return Batch(
            rollout=self.rollout.of_rows(rows),
            advantages=self.advantages[:, rows],
            returns=self.returns[:, rows],
            guide=None if self.guide is None else self.guide[:, rows],
        )


class PPO:
    """The learner of a policy.

    Attributes:
        policy: The policy.
        optimizer: Adam.
        return_moments: Running moments of the discounted return, which scale the rewards.
        guide: The policy from which fine-tuning started; None without a warm start.
    """

    def __init__(
        self, policy: Policy, config: PPOConfig, ranks: Ranks, guide: Guide | None = None
    ) -> None:
        self.policy, self.config, self.ranks, self.guide = policy, config, ranks, guide
        if config.final_log_std is not None:
            # Set by the share of the run that is over (`Recipe.log_std`), and not learned.
            policy.head.fix_spread()
        # PPO's usual epsilon; Adam's own is 1e-8.
        self.optimizer = torch.optim.Adam(
            policy.parameters(), lr=config.learning_rate, eps=1e-5, foreach=True
        )
        self.return_moments = RunningNormalizer(1).to(ranks.device)
        self.forget_returns()

    def forget_returns(self) -> None:
        """Starts the discounted returns anew, as all rows start new episodes."""
        self._running_return: Tensor | None = None
        if self.guide is not None:
            self.guide.forget()

    def update(
        self,
        rollout: Rollout,
        generator: torch.Generator,
        progress: float,
        stage: Stage = EVERYTHING,
    ) -> dict[str, float]:
        """Improves the policy with a rollout.

        Args:
            rollout: The steps of this rank.
            generator: Draws the minibatches of this rank.
            progress: Share of the run that is over, for the learning rate.
            stage: How this update learns.

        Returns:
            Metric -> value, the same on all ranks.
        """
        config = self.config
        rate = config.learning_rate * (1 - min(1.0, progress) if config.decays else 1.0)
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        module = self.policy.critic if stage.critic_only else self.policy
        parameters = [value for value in module.parameters() if value.requires_grad]
        batch = self._batch(rollout)
        parts = self._minibatches(rollout.valid.shape[1], generator)
        # All counts in one message; rows have different numbers of valid steps.
        counts = self.ranks.sum(torch.stack([rollout.valid[:, rows].sum() for rows in parts]))
        sums, norm = torch.zeros(len(METRICS), device=rollout.values.device), 0.0
        for rows, count in zip(parts, counts.tolist(), strict=True):
            loss, part = self._minibatch(batch.of_rows(rows), count, stage)
            gradients = torch.autograd.grad(loss, parameters, allow_unused=True)
            self.optimizer.zero_grad()
            for parameter, gradient in zip(parameters, gradients, strict=True):
                parameter.grad = gradient
            # Before clipping, which has to limit the sum and not one rank's part of it.
            self.ranks.sum_gradients(parameters)
            norm += float(nn.utils.clip_grad_norm_(parameters, config.max_gradient_norm))
            self.optimizer.step()
            sums += part
        means = self.ranks.sum(sums) / counts.sum()
        metrics = dict(zip(METRICS, means.tolist(), strict=True))
        metrics |= {"gradient_norm": norm / len(parts), "learning_rate": rate}
        metrics["explained_variance"] = self._explained(batch)
        # With a guide, the normalizers stay as the actor was fitted with them.
        if self.guide is None:
            del metrics["start_kl"]
            self._learn_normalizers(rollout)
        else:
            metrics["start_kl_weight"] = stage.kl_weight
        return metrics

    def _batch(self, rollout: Rollout) -> Batch:
        """Returns the rollout with advantages and returns, both in units of the scaled rewards."""
        config = self.config
        if config.scales_rewards:
            rollout.rewards = rollout.rewards * self._reward_scale(rollout)
        advantages = gae(rollout, config.discount, config.gae)
        # Before they are normalised: values are in the unit of the rewards.
        returns = advantages + rollout.values
        moments = self.ranks.merged(Moments.of(advantages[rollout.valid][:, None]))
        # Over the whole rollout and not by minibatch, so that a minibatch of poor steps stays one.
        deviation = (moments.squares / moments.count.clamp(min=1)).sqrt()
        normal = (advantages - moments.mean.float()) / (deviation.float() + 1e-8)
        return Batch(
            rollout=rollout,
            advantages=normal * rollout.valid,
            returns=returns,
            guide=None if self.guide is None else self.guide.outputs(rollout),
        )

    def _reward_scale(self, rollout: Rollout) -> Tensor:
        """Returns 1 / the running standard deviation of the discounted return, () float32."""
        before = self._running_return
        if before is None:
            before = torch.zeros_like(rollout.last_values)
        returns = discounted_returns(rollout, before, self.config.discount)
        self._running_return = returns[-1]
        moments = Moments.of(returns[rollout.valid][:, None])
        self.return_moments.learn(self.ranks.merged(moments))
        # Rewards keep their mean: to shift them would change how long episodes should last.
        variance = self.return_moments.squares / self.return_moments.count
        return (variance[0] + 1e-8).rsqrt().float()

    def _minibatches(self, rows: int, generator: torch.Generator) -> list[Tensor]:
        """Returns the rows of each gradient step; all steps of a row stay together."""
        parts: list[Tensor] = []
        for _ in range(self.config.epochs):
            # Rows and not steps are shuffled, as the LSTM is unrolled over a row's steps in order.
            order = torch.randperm(rows, generator=generator)
            parts += order.tensor_split(self.config.minibatches)
        return parts

    def _minibatch(
        self, batch: Batch, count: int, stage: Stage = EVERYTHING
    ) -> tuple[Tensor, Tensor]:
        """Returns the loss of this rank's part of `count` steps, and the sums of `METRICS`."""
        config, rollout, valid = self.config, batch.rollout, batch.rollout.valid
        judged = self.policy.judge(
            rollout.observations(), rollout.actions, rollout.starts, rollout.memory
        )
        # Masked before exp, as steps that reset a row have actions of no consequence.
        log_ratio = (judged.log_probs - rollout.log_probs) * valid
        ratio = log_ratio.exp()
        clipped = ratio.clamp(1 - config.clip, 1 + config.clip)
        # arXiv 1707.06347, equation 7.
        gains = torch.minimum(ratio * batch.advantages, clipped * batch.advantages)
        policy_loss = -(gains * valid).sum()
        value_loss = 0.5 * ((judged.values - batch.returns).square() * valid).sum()
        entropy = (judged.entropies * valid).sum()
        start_kl = self._start_kl(judged, batch)
        total = config.value_weight * value_loss
        if not stage.critic_only:
            total = total + policy_loss - config.entropy_weight * entropy
            total = total + stage.kl_weight * start_kl
        with torch.no_grad():
            outside = ((ratio - clipped).abs() > 0).sum()
            # Never negative, and of less variance than the mean of -log_ratio (Schulman 2020).
            kl = ((ratio - 1 - log_ratio) * valid).sum()
            sums = torch.stack((policy_loss, value_loss, entropy, outside, kl, start_kl))
        # The rows of a minibatch may have no valid step.
        return total / max(1, count), sums

    def _start_kl(self, judged: Judged, batch: Batch) -> Tensor:
        """Returns the sum () of KL(start || policy) over the valid steps."""
        if batch.guide is None or self.guide is None:
            return torch.zeros_like(judged.values[0, 0])
        head, valid = self.policy.head, batch.rollout.valid
        outputs, guide = judged.outputs.flatten(0, 1), batch.guide.flatten(0, 1)
        return (head.kl(outputs, self.guide.head, guide) * valid.flatten()).sum()

    def _explained(self, batch: Batch) -> float:
        """Returns the share of the variance of the returns that the values explained."""
        valid = batch.rollout.valid
        errors = (batch.returns - batch.rollout.values)[valid]
        both = torch.stack((errors, batch.returns[valid]), dim=1)
        squares = self.ranks.merged(Moments.of(both)).squares
        return float(1 - squares[0] / squares[1].clamp(min=1e-8))

    def _learn_normalizers(self, rollout: Rollout) -> None:
        """Adds the observations; after the update, so that acting and learning saw the same."""
        policy, obs = self.policy, rollout.observations()
        policy.state_normalizer.learn(self.ranks.merged(Moments.of(obs.state)))
        if policy.image_normalizer is not None and obs.images is not None:
            channels = obs.images.shape[1]
            parts = [
                Moments.of(images.permute(0, 2, 3, 1).reshape(-1, channels))
                for images in obs.images.split(64)
            ]
            moments = parts[0]
            for part in parts[1:]:
                moments = moments.merged(part)
            policy.image_normalizer.learn(self.ranks.merged(moments))
