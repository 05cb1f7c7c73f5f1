"""Blind Pick: the arm and the displacement to the object, no images (S Table 2, "Blind").

PPO alone. Half of the training starts are at the fridge, where the straight way to an object meets
the shelf: with the one in six of the benchmark's start states, one of three seeds never found the
way around it.
"""

from hab_ppo.recipe import EnvConfig, Recipe

RECIPE = Recipe(
    name="pick_blind",
    about="Pick from the arm's state and the object's starting position.",
    env=EnvConfig(
        env="HabPick-v1",
        control_mode="ee",
        trained_in="hab_ppo.fridge_starts:PickOftenFromFridge-v1",
        num_episodes=5000,
    ),
    total_steps=1_300_000,
)
