"""Open and close a drawer (S App. H.2): with and without images.

The reward pays for little but the finished skill, so random actions never find it.
"""

from dataclasses import replace

from hab_ppo.recipe import RECURRENT, VISUAL, Distillation, EnvConfig, Recipe, WarmStart

# Demonstrations of SPA-Priv are cloned before PPO. The handle's position is no part of the paper's
# observation; without it and without images, the handle cannot be found.
OPEN_DRAWER_BLIND = Recipe(
    name="open_drawer_blind",
    about="Open a drawer from the state of the arm and the position of the handle.",
    env=EnvConfig(env="HabOpenDrawer-v1", control_mode="ee", handle_position=True),
    preset=RECURRENT,
    total_steps=1_000_000,
    warm_start=WarmStart(),
)

# Here the handle's position says how far the drawer is open.
CLOSE_DRAWER_BLIND = replace(
    OPEN_DRAWER_BLIND,
    name="close_drawer_blind",
    about="Close a drawer from the state of the arm and the position of the handle.",
    env=replace(OPEN_DRAWER_BLIND.env, env="HabCloseDrawer-v1"),
)

# Rendering is expensive, so an expert labels the states that the policy visits (DAgger). It knows
# the handle, which this policy finds in the images.
OPEN_DRAWER_DEPTH = Recipe(
    name="open_drawer_depth",
    about="Open a drawer with the depth images of both cameras.",
    env=EnvConfig(env="HabOpenDrawer-v1", control_mode="ee", obs_mode="depth"),
    preset=VISUAL,
    total_steps=100_000,
    distill=Distillation(expert="drawer_action"),
)

CLOSE_DRAWER_DEPTH = replace(
    OPEN_DRAWER_DEPTH,
    name="close_drawer_depth",
    about="Close a drawer with the depth images of both cameras.",
    env=replace(OPEN_DRAWER_DEPTH.env, env="HabCloseDrawer-v1"),
)
