"""Close the fridge with arm and base, without images (S App. H.2).

The handle's position is no part of the paper's observation; it says how far the door is open.
"""

from hab_ppo.recipe import EnvConfig, Recipe

RECIPE = Recipe(
    name="close_fridge_blind",
    about="Close the fridge from the state of the arm and the position of the handle.",
    env=EnvConfig(env="HabCloseFridge-v1", control_mode="ee_base", handle_position=True),
)
