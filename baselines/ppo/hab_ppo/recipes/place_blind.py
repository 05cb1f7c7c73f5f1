"""Blind Place: the arm and the displacement to the goal, no images (S App. H.2)."""

from hab_ppo.recipe import EnvConfig, Recipe

RECIPE = Recipe(
    name="place_blind",
    about="Place from the arm's state and the object's goal.",
    env=EnvConfig(env="HabPlace-v1", control_mode="ee"),
)
