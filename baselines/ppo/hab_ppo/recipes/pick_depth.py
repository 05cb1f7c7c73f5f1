"""Depth Pick, from the arm's state and both depth cameras (S App. H.2).

Frames with images are dear, so an expert that knows all objects labels the states that the policy
visits (DAgger).
"""

from hab_ppo.recipe import VISUAL, Distillation, EnvConfig, Recipe

RECIPE = Recipe(
    name="pick_depth",
    about="Pick with the depth images of both cameras.",
    env=EnvConfig(env="HabPick-v1", control_mode="ee", obs_mode="depth", num_episodes=2000),
    preset=VISUAL,
    total_steps=100_000,
    distill=Distillation(expert="pick_action"),
)
