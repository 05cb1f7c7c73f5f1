"""Open a drawer without images (S App. H.2).

The handle's position is no part of the paper's observation; without it and without images, the
handle cannot be found.
"""

from hab_ppo.recipe import EnvConfig, Recipe

RECIPE = Recipe(
    name="open_drawer_blind",
    about="Open a drawer from the state of the arm and the position of the handle.",
    env=EnvConfig(env="HabOpenDrawer-v1", control_mode="ee", handle_position=True),
)
