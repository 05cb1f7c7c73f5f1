"""Close a drawer without images (S App. H.2).

Demonstrations of SPA-Priv are cloned before PPO: the reward pays for little but the finished skill,
so random actions never find it. The handle's position is no part of the paper's observation;
it says how far the drawer is open.
"""

from hab_ppo.recipe import RECURRENT, EnvConfig, Recipe, WarmStart

RECIPE = Recipe(
    name="close_drawer_blind",
    about="Close a drawer from the state of the arm and the position of the handle.",
    env=EnvConfig(env="HabCloseDrawer-v1", control_mode="ee", handle_position=True),
    preset=RECURRENT,
    total_steps=1_000_000,
    warm_start=WarmStart(),
)
