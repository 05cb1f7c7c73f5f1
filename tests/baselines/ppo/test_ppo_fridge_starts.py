"""Environments for training with many start states at the fridge."""

from dataclasses import replace

import pytest
from hab_ppo.distributed import Ranks
from hab_ppo.episodes import EpisodeSupply
from hab_ppo.recipes import find_recipe
from hab_ppo.warm_start import make_rows

NAMES = ("pick_fridge", "place_fridge", "close_fridge_depth")


def test_evaluations_are_in_the_environment_of_the_skill():
    recipe = find_recipe("pick_fridge")
    few = replace(recipe, env=replace(recipe.env, num_episodes=2), evaluation_episodes=2)
    with EpisodeSupply(few, Ranks(), lambda line: None) as supply:
        assert {one.id.split("/")[0] for one in supply.evaluation} == {"HabPick-v1"}


@pytest.mark.parametrize(
    "name", ["open_fridge_blind", *(pytest.param(n, marks=pytest.mark.slow) for n in NAMES)]
)
def test_policies_of_these_environments_are_policies_of_the_skill(name):
    recipe = find_recipe(name)
    assert recipe.env.trained_in is not None
    rows = make_rows(recipe, 2, 1)
    skill = make_rows(replace(recipe, env=replace(recipe.env, trained_in=None)), 2, 1)
    try:
        assert rows.spec.id == recipe.env.trained_in.rpartition(":")[2]
        assert rows.single_observation_space == skill.single_observation_space
        assert rows.single_action_space == skill.single_action_space
    finally:
        rows.close()
        skill.close()
