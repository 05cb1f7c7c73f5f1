"""Depth Open drawer, from the arm's state and both depth cameras (S App. H.2).

Frames with images are dear, so an expert labels the states that the policy visits (DAgger). It
knows the handle, which this policy finds in the images.
"""

from hab_ppo.recipe import VISUAL, Distillation, EnvConfig, Recipe

RECIPE = Recipe(
    name="open_drawer_depth",
    about="Open a drawer with the depth images of both cameras.",
    env=EnvConfig(env="HabOpenDrawer-v1", control_mode="ee", obs_mode="depth"),
    preset=VISUAL,
    total_steps=100_000,
    distill=Distillation(expert="drawer_action"),
)
