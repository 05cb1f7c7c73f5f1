"""Depth Place, from the arm's state and both depth cameras (S App. H.2).

Frames with images are dear, so `place_blind` teaches it first.
"""

from hab_ppo.recipe import VISUAL, Distillation, EnvConfig, Recipe

RECIPE = Recipe(
    name="place_depth",
    about="Place with the depth images of both cameras.",
    env=EnvConfig(env="HabPlace-v1", control_mode="ee", obs_mode="depth"),
    preset=VISUAL,
    total_steps=1_000_000,
    distill=Distillation(teacher="place_blind"),
)
