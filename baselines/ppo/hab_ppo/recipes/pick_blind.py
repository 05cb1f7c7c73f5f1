"""Blind Pick: the arm and the displacement to the object, no images (S Table 2, "Blind")."""

from hab_ppo.recipe import EnvConfig, Recipe

RECIPE = Recipe(
    name="pick_blind",
    about="Pick from the arm's state and the object's starting position.",
    env=EnvConfig(env="HabPick-v1", control_mode="ee", num_episodes=5000),
    total_steps=1_500_000,
)
