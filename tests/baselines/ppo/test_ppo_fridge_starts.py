"""Environments for training with many start states at the fridge."""

from dataclasses import replace

import pytest
from hab_ppo.episodes import prepare_episodes, training_request
from hab_ppo.recipes import find_recipe
from hab_ppo.warm_start import make_rows

from hab_tasks.episodes import load_episodes
from hab_tasks.receptacles import FRIDGE

COUNT = 12
RECIPES = ["pick_fridge", "place_fridge"]
slow = pytest.mark.slow


@slow
@pytest.mark.parametrize("name", RECIPES)
def test_half_of_the_start_states_are_at_the_fridge(name):
    request = training_request(find_recipe(name))
    targets = [episode.targets[0] for episode in load_episodes(request, 2 * COUNT).episodes]
    receptacles = [one.start or one.goal for one in targets]
    # 1/2 and 1/6 or 1/7 of the others are expected: 14 of 24, with a standard deviation of 2.4.
    at_fridge = sum(ref is not None and ref[0] == FRIDGE for ref in receptacles)
    assert 6 <= at_fridge <= 22


def test_evaluations_are_in_the_environment_of_the_skill():
    recipe = find_recipe("pick_fridge")
    few = replace(recipe, env=replace(recipe.env, num_episodes=2), evaluation_episodes=2)
    episodes = prepare_episodes(few, 1, lambda line: None)
    assert {episode.id.split("/")[0] for episode in episodes} == {"HabPick-v1"}


@pytest.mark.parametrize(
    "name",
    ["open_fridge_blind", *(pytest.param(n, marks=slow) for n in [*RECIPES, "close_fridge_depth"])],
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
