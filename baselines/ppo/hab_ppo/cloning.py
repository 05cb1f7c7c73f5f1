"""Behaviour cloning: fits a policy's actions to examples.

The normalisers are set to the moments of the data first. The loss is the squared error of the
means of continuous actions, or the cross-entropy of cells. A network without memory is fitted to
single steps in random order, one with an LSTM to whole episodes. A share of the episodes is held
out; the weights with the least loss on these are kept. The value head is left alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from hab_ppo.examples import Examples
from hab_ppo.layers import half_precision
from hab_ppo.network import Policy
from hab_ppo.normalizer import Moments, RunningNormalizer
from hab_ppo.progress import WriteLine
from hab_ppo.recipe import Cloning

LINES = 5
"""Progress lines of a fit."""

IMAGES_AT_A_TIME = 64


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Result of a fit.

    Attributes:
        epochs: Number of passes made.
        loss: Mean loss on the fitted steps in the last one.
        held_out_loss: Least mean loss on the episodes held out; on the fitted ones if there are
            none.
    """

    epochs: int
    loss: float
    held_out_loss: float


def clone(
    policy: Policy, examples: Examples, config: Cloning, seed: int, write_line: WriteLine
) -> Fit:
    """Fits a policy to examples; see the module.

    Args:
        policy: The policy; its device is kept.
        examples: The examples.
        config: The fit.
        seed: Seed of the share held out and of the order of the steps.
        write_line: Receives progress lines.
    """
    generator = torch.Generator().manual_seed(seed)
    set_normalizers(policy, examples)
    order = torch.randperm(len(examples.lengths), generator=generator)
    count = int(config.held_out * len(order))
    held_out = examples.episodes(order[:count].sort().values)
    fitted = examples.episodes(order[count:].sort().values)
    parameters = [p for name, p in policy.named_parameters() if not name.startswith("critic.")]
    optimizer = torch.optim.Adam(parameters, lr=config.learning_rate, foreach=True)
    best, kept, since, epoch, loss = float("inf"), policy.state_dict(), 0, 0, 0.0
    for epoch in range(1, config.epochs + 1):
        loss = _epoch(policy, fitted, config, optimizer, generator)
        judged = mean_misfit(policy, held_out, config.batch_steps) if count else loss
        since += 1
        if judged < best:
            best, since = judged, 0
            kept = {name: value.clone() for name, value in policy.state_dict().items()}
        if epoch % max(1, config.epochs // LINES) == 0:
            write_line(f"cloning, epoch {epoch}: loss {loss:.4f}, held out {judged:.4f}")
        if since >= config.patience:
            break
    policy.load_state_dict(kept)
    return Fit(epochs=epoch, loss=loss, held_out_loss=best)


def set_normalizers(policy: Policy, examples: Examples) -> None:
    """Sets the normalisers to the moments of the data."""
    device = policy.state_normalizer.mean.device
    _set(policy.state_normalizer, Moments.of(examples.state.to(device)))
    if policy.image_normalizer is not None and examples.images is not None:
        channels = examples.images.shape[1]
        total = Moments.of(torch.zeros(0, channels, device=device))
        for images in examples.images.split(IMAGES_AT_A_TIME):
            values = images.to(device).float().permute(0, 2, 3, 1).reshape(-1, channels)
            total = total.merged(Moments.of(values))
        _set(policy.image_normalizer, total)


def _set(normalizer: RunningNormalizer, moments: Moments) -> None:
    for buffer in (normalizer.count, normalizer.mean, normalizer.squares):
        buffer.zero_()
    normalizer.learn(moments)


def _epoch(
    policy: Policy,
    examples: Examples,
    config: Cloning,
    optimizer: torch.optim.Optimizer,
    generator: torch.Generator,
) -> float:
    """Makes a pass over the data; returns the mean loss."""
    total = 0.0
    for batch in batches(examples, config.batch_steps, policy.lstm is not None, generator):
        with half_precision(policy.state_normalizer.mean.device, config.bfloat16):
            loss = misfits(policy, batch).mean()
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(policy.parameters(), 1.0)
        optimizer.step()
        total += float(loss.detach()) * len(batch.state)
    return total / len(examples.state)


@torch.no_grad()
def mean_misfit(policy: Policy, examples: Examples, batch_steps: int) -> float:
    """Returns the mean loss on examples."""
    total = 0.0
    for batch in batches(examples, batch_steps, policy.lstm is not None, None):
        total += float(misfits(policy, batch).sum())
    return total / len(examples.state)


def batches(
    examples: Examples, steps: int, whole: bool, generator: torch.Generator | None
) -> list[Examples]:
    """Returns examples in batches of about this many steps.

    Args:
        examples: The examples.
        steps: Number of steps.
        whole: Whether episodes are kept whole.
        generator: Draws the order; None to keep it.
    """
    count = len(examples.lengths if whole else examples.state)
    order = torch.arange(count)
    if generator is not None:
        order = torch.randperm(count, generator=generator)
    if not whole:
        ones = torch.ones(steps, dtype=torch.long)
        return [examples.steps(part, ones[: len(part)]) for part in order.split(steps)]
    found: list[Examples] = []
    part: list[Tensor] = []
    length = 0
    for number in order:
        part.append(number)
        length += int(examples.lengths[number])
        if length >= steps:
            found.append(examples.episodes(torch.stack(part)))
            part, length = [], 0
    return found + ([examples.episodes(torch.stack(part))] if part else [])


def misfits(policy: Policy, batch: Examples) -> Tensor:
    """Returns the loss of each step (M,), with gradients; episodes follow each other in one row."""
    device = policy.state_normalizer.mean.device
    starts = batch.starts()[:, None]
    obs = batch.observations().to(device)
    features, _ = policy.features(obs, starts, policy.no_memory(1))
    actions = policy.head.from_env(batch.actions.numpy()).to(device)
    return policy.head.misfit(policy.outputs(features, obs), actions)
