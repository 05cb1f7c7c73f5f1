"""Open and close drawers, and the fridge with arm and base (S App. H.2), with and without images.

The reward pays for little but the finished skill, so random actions never find it. An expert that
knows the door's axis labels the states that the policy visits (DAgger) before PPO.
"""

from dataclasses import replace
from typing import Any

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


def _blind(name: str, what: str, env: EnvConfig, **others: Any) -> Recipe:
    """Returns a recipe without images.

    The handle's position is no part of the paper's observation; without it and without images, the
    handle cannot be found. A policy that closes also knows from it how far it still is.
    """
    return Recipe(
        name=f"{name}_blind",
        about=f"{what} from the state of the arm and the position of the handle.",
        env=replace(env, handle_position=True),
        preset=RECURRENT,
        **others,
    )


def _depth(name: str, what: str, env: EnvConfig, distill: Distillation) -> Recipe:
    """Returns a recipe with images, in which the policy finds the handle.

    Rendering is expensive, so an expert that knows the handle labels the visited states.
    """
    return Recipe(
        name=f"{name}_depth",
        about=f"{what} with the depth images of both cameras.",
        env=replace(env, obs_mode="depth"),
        preset=VISUAL,
        total_steps=100_000,
        distill=distill,
    )


OPEN_FRIDGE = EnvConfig(env="HabOpenFridge-v1", control_mode="ee_base")
CLOSE_FRIDGE = EnvConfig(env="HabCloseFridge-v1", control_mode="ee_base")
OPEN_DRAWER = EnvConfig(env="HabOpenDrawer-v1", control_mode="ee")
CLOSE_DRAWER = EnvConfig(env="HabCloseDrawer-v1", control_mode="ee")

# The policy does not observe the borders of its region: half of the start states are in a corner of
# it, so that it learns a way that stays inside from there too.
OPEN_FRIDGE_BLIND = _blind(
    "open_fridge",
    "Open the fridge",
    replace(
        OPEN_FRIDGE, trained_in="hab_ppo.fridge_starts:OpenFridgeFromCorners-v1", num_episodes=2000
    ),
    total_steps=400_000,
    evaluation_episodes=100,
    distill=Distillation(
        expert="door_action", tuning=FineTuning(log_std=-1.4, kl_weight=0.1, kl_steps=200_000)
    ),
)

CLOSE_FRIDGE_BLIND = _blind(
    "close_fridge",
    "Close the fridge",
    CLOSE_FRIDGE,
    total_steps=200_000,
    distill=Distillation(expert="door_action"),
)

OPEN_FRIDGE_DEPTH = _depth(
    "open_fridge", "Open the fridge", OPEN_FRIDGE, Distillation(expert="door_action", rounds=8)
)

# The door is open up to its limit, as in a task after Open fridge.
CLOSE_FRIDGE_DEPTH = _depth(
    "close_fridge",
    "Close the fridge",
    replace(
        CLOSE_FRIDGE, trained_in="hab_ppo.fridge_starts:CloseWideOpenFridge-v1", num_episodes=1000
    ),
    Distillation(
        expert="door_action", rounds=6, cloning=Cloning(epochs=10, patience=10, bfloat16=True)
    ),
)

# Demonstrations of SPA-Priv are cloned before PPO.
OPEN_DRAWER_BLIND = _blind(
    "open_drawer", "Open a drawer", OPEN_DRAWER, total_steps=1_000_000, warm_start=WarmStart()
)

CLOSE_DRAWER_BLIND = _blind(
    "close_drawer", "Close a drawer", CLOSE_DRAWER, total_steps=1_000_000, warm_start=WarmStart()
)

OPEN_DRAWER_DEPTH = _depth(
    "open_drawer", "Open a drawer", OPEN_DRAWER, Distillation(expert="drawer_action")
)

CLOSE_DRAWER_DEPTH = _depth(
    "close_drawer", "Close a drawer", CLOSE_DRAWER, Distillation(expert="drawer_action")
)
