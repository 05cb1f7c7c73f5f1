"""Examples in the toy environment of `toy_vector`."""

import torch
from hab_ppo.examples import Examples


def random_examples(lengths, act, *, seed=0):
    """Episodes of random states; `act` maps the states (T, 2) of one to actions (T, 1)."""
    drawn = torch.Generator().manual_seed(seed)
    state = torch.rand(sum(lengths), 2, generator=drawn) * 2 - 1
    actions = torch.cat([act(part) for part in state.split(lengths)])
    return Examples(state=state, images=None, actions=actions, lengths=torch.tensor(lengths))


def linear(state):
    return 0.6 * state[:, :1] - 0.3 * state[:, 1:]
