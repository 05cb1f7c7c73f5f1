"""The classes of all environments; importing this registers them with ManiSkill as well."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module

from mani_skill.utils.registration import register

from hab_tasks.registration import ENTRY_POINTS
from hab_tasks.skills.hab_env import HabEnv


@dataclass(frozen=True, kw_only=True)
class EnvEntry:
    """One environment: its id, its class and the longest episode."""

    id: str
    env: type[HabEnv]
    horizon_steps: int


def _load(env_id: str) -> EnvEntry:
    module, _, name = ENTRY_POINTS[env_id][0].partition(":")
    env = getattr(import_module(module), name)
    return EnvEntry(id=env_id, env=env, horizon_steps=env.horizon_steps)


ENVS: dict[str, EnvEntry] = {env_id: _load(env_id) for env_id in ENTRY_POINTS}

for _env in ENVS.values():
    register(_env.id, _env.env, max_episode_steps=_env.horizon_steps)
