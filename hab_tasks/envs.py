"""The single table of environments; importing it registers them with Gymnasium and ManiSkill."""

from __future__ import annotations

from dataclasses import dataclass

from mani_skill.utils.registration import register_env

from hab_tasks.skills.base import SkillEnv
from hab_tasks.skills.pick import HabPickEnv


@dataclass(frozen=True, kw_only=True)
class EnvEntry:
    """One environment: its id, its class and the longest episode."""

    id: str
    env: type[SkillEnv]
    horizon_steps: int


def _entry(env_id: str, env: type[SkillEnv]) -> EnvEntry:
    return EnvEntry(id=env_id, env=env, horizon_steps=env.skill.horizon_steps)


ENVS: dict[str, EnvEntry] = {entry.id: entry for entry in (_entry("HabPick-v1", HabPickEnv),)}

for _env in ENVS.values():
    register_env(_env.id, max_episode_steps=_env.horizon_steps)(_env.env)
