"""Examples and runs in the toy environment of `toy_vector`."""

from dataclasses import replace

import torch
from hab_ppo import checkpoint, rows
from hab_ppo.episodes import EpisodeSupply
from hab_ppo.examples import Examples
from hab_ppo.recipe import FAST, EnvConfig, NetworkConfig, Recipe
from toy_vector import ToyVector, goals

TOY = Recipe(
    name="toy",
    about="A toy.",
    env=EnvConfig(env="HabPick-v1", control_mode="ee"),
    preset=replace(
        FAST,
        network=NetworkConfig(lstm_size=8, head_layers=(16,)),
        ppo=replace(FAST.ppo, final_log_std=None, decays=False),  # runs are cut short
        rollout_steps=20,
    ),
    total_steps=1200,
    evaluation_steps=400,
    evaluation_episodes=6,
)


def replace_simulator(monkeypatch):
    """Runs train and evaluate in the toy."""
    monkeypatch.setattr(EpisodeSupply, "__init__", lambda self, *_: None)
    monkeypatch.setattr(EpisodeSupply, "end", lambda self: None)
    monkeypatch.setattr(EpisodeSupply, "grow", lambda *_: None)
    monkeypatch.setattr(EpisodeSupply, "evaluation", goals(6))
    monkeypatch.setattr(rows.gym, "make_vec", lambda _, num_envs, **__: ToyVector(num_envs))


def same_tensors(one, other):
    """Whether two files of weights hold the same."""
    found, expected = checkpoint.load(one)[0], checkpoint.load(other)[0]
    assert found.keys() == expected.keys()
    return all(torch.equal(found[name], expected[name]) for name in found)


def random_examples(lengths, act, *, seed=0):
    """Episodes of random states; `act` maps the states (T, 2) of one to actions (T, 1)."""
    drawn = torch.Generator().manual_seed(seed)
    state = torch.rand(sum(lengths), 2, generator=drawn) * 2 - 1
    actions = torch.cat([act(part) for part in state.split(lengths)])
    return Examples(state=state, images=None, actions=actions, lengths=torch.tensor(lengths))


def linear(state):
    return 0.6 * state[:, :1] - 0.3 * state[:, 1:]
