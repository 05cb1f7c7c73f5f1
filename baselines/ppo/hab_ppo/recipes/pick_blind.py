"""Blind Pick: the arm and the displacement to the object, no images (S Table 2, "Blind").

PPO alone, from the benchmark's start states. With half of them at the fridge
(`hab_ppo.fridge_starts`), three seeds were at 74, 55 and 51 % of 100 validation episodes after
600,000 steps; the policy that ships was at 84 % of 50.
"""

from hab_ppo.recipe import EnvConfig, Recipe

RECIPE = Recipe(
    name="pick_blind",
    about="Pick from the arm's state and the object's starting position.",
    env=EnvConfig(env="HabPick-v1", control_mode="ee", num_episodes=5000),
    total_steps=1_500_000,
)
