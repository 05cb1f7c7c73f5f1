"""Open the fridge with arm and base, without images (S App. H.2).

The handle's position is no part of the paper's observation; without it and without images, the
handle cannot be found.
"""

from hab_ppo.recipe import EnvConfig, Recipe

RECIPE = Recipe(
    name="open_fridge_blind",
    about="Open the fridge from the state of the arm and the position of the handle.",
    env=EnvConfig(env="HabOpenFridge-v1", control_mode="ee_base", handle_position=True),
)
