"""Registers the environments with Gymnasium, by name: nothing of them is imported here.

Making one imports its class, in this process or in a worker of `gymnasium.make_vec`.
"""

from __future__ import annotations

import gymnasium as gym
from gymnasium.envs.registration import WrapperSpec

from hab_tasks.constants import (
    NAVIGATE_HORIZON_STEPS,
    PREPARE_GROCERIES_HORIZON_STEPS,
    SET_TABLE_HORIZON_STEPS,
    SKILL_HORIZON_STEPS,
    TIDY_HOUSE_HORIZON_STEPS,
)

ENTRY_POINTS: dict[str, tuple[str, int]] = {
    "HabPick-v1": ("hab_tasks.skills.pick:HabPickEnv", SKILL_HORIZON_STEPS),
    "HabPlace-v1": ("hab_tasks.skills.place:HabPlaceEnv", SKILL_HORIZON_STEPS),
    "HabOpenFridge-v1": ("hab_tasks.skills.open_fridge:HabOpenFridgeEnv", SKILL_HORIZON_STEPS),
    "HabCloseFridge-v1": ("hab_tasks.skills.close_fridge:HabCloseFridgeEnv", SKILL_HORIZON_STEPS),
    "HabOpenDrawer-v1": ("hab_tasks.skills.open_drawer:HabOpenDrawerEnv", SKILL_HORIZON_STEPS),
    "HabCloseDrawer-v1": ("hab_tasks.skills.close_drawer:HabCloseDrawerEnv", SKILL_HORIZON_STEPS),
    "HabNavigate-v1": ("hab_tasks.skills.navigate:HabNavigateEnv", NAVIGATE_HORIZON_STEPS),
    "HabTidyHouse-v1": ("hab_tasks.tasks.tidy_house:HabTidyHouseEnv", TIDY_HOUSE_HORIZON_STEPS),
    "HabPrepareGroceries-v1": (
        "hab_tasks.tasks.prepare_groceries:HabPrepareGroceriesEnv",
        PREPARE_GROCERIES_HORIZON_STEPS,
    ),
    "HabSetTable-v1": ("hab_tasks.tasks.set_table:HabSetTableEnv", SET_TABLE_HORIZON_STEPS),
}
"""Id -> where its class is, and its `horizon_steps`, the longest episode."""


def register_envs() -> None:
    """Adds every environment to Gymnasium's registry, with ManiSkill's time limit."""
    for env_id, (entry_point, horizon_steps) in ENTRY_POINTS.items():
        limit = WrapperSpec(
            "MSTimeLimit",
            entry_point="mani_skill.utils.registration:TimeLimitWrapper",
            kwargs={"max_episode_steps": horizon_steps},
        )
        gym.register(
            env_id,
            entry_point=entry_point,
            max_episode_steps=horizon_steps,
            disable_env_checker=True,  # ManiSkill's observations are tensors
            additional_wrappers=(limit,),
        )
