"""Depth Close fridge, from the arm's state and both depth cameras (S App. H.2).

Frames with images are dear, so an expert labels the states that the policy visits (DAgger). It
knows the handle, which this policy finds in the images.
"""

from hab_ppo.recipe import VISUAL, Distillation, EnvConfig, Recipe

RECIPE = Recipe(
    name="close_fridge_depth",
    about="Close the fridge with the depth images of both cameras.",
    env=EnvConfig(env="HabCloseFridge-v1", control_mode="ee_base", obs_mode="depth"),
    preset=VISUAL,
    total_steps=100_000,
    distill=Distillation(expert="door_action"),
)
