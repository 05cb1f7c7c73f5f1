"""Blind Place: the arm and the displacement to the goal, no images (S App. H.2).

Demonstrations of SPA-Priv are cloned before PPO: a dropped object cannot be taken again, so PPO
alone settles for throwing it from some distance, which succeeds in two of three episodes.
"""

from hab_ppo.recipe import EnvConfig, Recipe, WarmStart

RECIPE = Recipe(
    name="place_blind",
    about="Place from the arm's state and the object's goal.",
    env=EnvConfig(env="HabPlace-v1", control_mode="ee", num_episodes=5000),
    total_steps=1_500_000,
    warm_start=WarmStart(),
)
