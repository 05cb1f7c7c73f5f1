"""The classes of all environments; importing this registers them with ManiSkill as well."""

from __future__ import annotations

from dataclasses import dataclass

from mani_skill.utils.registration import register

from hab_tasks.skills.close_drawer import HabCloseDrawerEnv
from hab_tasks.skills.close_fridge import HabCloseFridgeEnv
from hab_tasks.skills.hab_env import HabEnv
from hab_tasks.skills.navigate import HabNavigateEnv
from hab_tasks.skills.open_drawer import HabOpenDrawerEnv
from hab_tasks.skills.open_fridge import HabOpenFridgeEnv
from hab_tasks.skills.pick import HabPickEnv
from hab_tasks.skills.place import HabPlaceEnv
from hab_tasks.tasks.prepare_groceries import HabPrepareGroceriesEnv
from hab_tasks.tasks.set_table import HabSetTableEnv
from hab_tasks.tasks.tidy_house import HabTidyHouseEnv


@dataclass(frozen=True, kw_only=True)
class EnvEntry:
    """One environment: its id, its class and the longest episode."""

    id: str
    env: type[HabEnv]
    horizon_steps: int


_CLASSES: tuple[type[HabEnv], ...] = (
    HabPickEnv,
    HabPlaceEnv,
    HabOpenFridgeEnv,
    HabCloseFridgeEnv,
    HabOpenDrawerEnv,
    HabCloseDrawerEnv,
    HabNavigateEnv,
    HabTidyHouseEnv,
    HabPrepareGroceriesEnv,
    HabSetTableEnv,
)

ENVS: dict[str, EnvEntry] = {
    env.default_id(): EnvEntry(id=env.default_id(), env=env, horizon_steps=env.horizon_steps)
    for env in _CLASSES
}

for _env in ENVS.values():
    register(_env.id, _env.env, max_episode_steps=_env.horizon_steps)
