"""Close a drawer without images (S App. H.2).

The handle's position is no part of the paper's observation; it says how far the drawer is open.
"""

from hab_ppo.recipe import EnvConfig, Recipe

RECIPE = Recipe(
    name="close_drawer_blind",
    about="Close a drawer from the state of the arm and the position of the handle.",
    env=EnvConfig(env="HabCloseDrawer-v1", control_mode="ee", handle_position=True),
)
