"""Open a drawer without images (S App. H.2).

Demonstrations of SPA-Priv are cloned before PPO: the reward pays for little but the finished skill,
so random actions never find it. The handle's position is no part of the paper's observation;
without it and without images, the handle cannot be found.
"""

from hab_ppo.recipe import RECURRENT, EnvConfig, Recipe, WarmStart

RECIPE = Recipe(
    name="open_drawer_blind",
    about="Open a drawer from the state of the arm and the position of the handle.",
    env=EnvConfig(env="HabOpenDrawer-v1", control_mode="ee", handle_position=True),
    preset=RECURRENT,
    total_steps=1_000_000,
    warm_start=WarmStart(),
)
