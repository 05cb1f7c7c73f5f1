"""Untrained policies in files of weights."""

from hab_ppo import checkpoint
from hab_ppo.agent import spec_of
from hab_ppo.network import new_policy
from hab_ppo.observation import ObservationLayout

from hab_tasks.agent_spaces import agent_spaces
from hab_tasks.typed_values import to_json


def write_weights(recipe, path):
    """Writes untrained weights of a recipe."""
    spaces = agent_spaces(recipe.env.env, spec_of(recipe))
    layout = ObservationLayout.of(spaces.observation, recipe.preset.network.image_block_px)
    policy = new_policy(layout, spaces.action, recipe.preset.network, seed=3)
    checkpoint.save(path, checkpoint.network_tensors(policy), {"recipe": to_json(recipe)})
