"""Open and close drawers, and the fridge with arm and base (S App. H.2), with and without images.

The reward pays for little but the finished skill, so random actions never find it. An expert that
knows the door's axis labels the states that the policy visits (DAgger) before PPO.
"""

from dataclasses import replace

from hab_ppo.recipe import (
    RECURRENT,
    VISUAL,
    Cloning,
    Distillation,
    EnvConfig,
    FineTuning,
    Recipe,
    WarmStart,
)

# The handle's position is no part of the paper's observation; without it and without images, the
# handle cannot be found. The policy does not observe the borders of its region either: half of the
# start states are in a corner of it, so that it learns a way that stays inside from there too.
OPEN_FRIDGE_BLIND = Recipe(
    name="open_fridge_blind",
    about="Open the fridge from the state of the arm and the position of the handle.",
    env=EnvConfig(
        env="HabOpenFridge-v1",
        trained_in="hab_ppo.fridge_starts:OpenFridgeFromCorners-v1",
        control_mode="ee_base",
        handle_position=True,
        num_episodes=2000,
    ),
    preset=RECURRENT,
    total_steps=400_000,
    evaluation_episodes=100,
    distill=Distillation(
        expert="door_action", tuning=FineTuning(log_std=-1.4, kl_weight=0.1, kl_steps=200_000)
    ),
)

# Here the handle's position says how far the door is open.
CLOSE_FRIDGE_BLIND = Recipe(
    name="close_fridge_blind",
    about="Close the fridge from the state of the arm and the position of the handle.",
    env=EnvConfig(env="HabCloseFridge-v1", control_mode="ee_base", handle_position=True),
    preset=RECURRENT,
    total_steps=200_000,
    distill=Distillation(expert="door_action"),
)

# The expert knows the handle, which this policy finds in the images.
OPEN_FRIDGE_DEPTH = Recipe(
    name="open_fridge_depth",
    about="Open the fridge with the depth images of both cameras.",
    env=EnvConfig(env="HabOpenFridge-v1", control_mode="ee_base", obs_mode="depth"),
    preset=VISUAL,
    total_steps=100_000,
    distill=Distillation(expert="door_action", rounds=8),
)

# The door is open up to its limit, as in a task after Open fridge.
CLOSE_FRIDGE_DEPTH = Recipe(
    name="close_fridge_depth",
    about="Close the fridge with the depth images of both cameras.",
    env=EnvConfig(
        env="HabCloseFridge-v1",
        trained_in="hab_ppo.fridge_starts:CloseWideOpenFridge-v1",
        control_mode="ee_base",
        obs_mode="depth",
        num_episodes=1000,
    ),
    preset=VISUAL,
    total_steps=100_000,
    distill=Distillation(
        expert="door_action", rounds=6, cloning=Cloning(epochs=10, patience=10, bfloat16=True)
    ),
)


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
