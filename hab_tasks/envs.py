"""Classes of all environments; accessing one also registers it with ManiSkill."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache

from mani_skill.utils.registration import register

from hab_tasks.engine.hab_env import HabEnv
from hab_tasks.registration import ENTRY_POINTS, class_of, imported_id


@dataclass(frozen=True, kw_only=True)
class EnvEntry:
    """An environment: id, class and maximum episode length."""

    id: str
    env: type[HabEnv]
    horizon_steps: int


class Environments(Mapping[str, EnvEntry]):
    """All registered environments by id, including user-defined ones.

    Looking up ``module:X-v1`` imports the module.
    """

    def __getitem__(self, reference: str) -> EnvEntry:
        """Returns an environment.

        Raises:
            UnknownNameError: Unknown environment id.
        """
        return _load(imported_id(reference))

    def __contains__(self, env_id: object) -> bool:
        return env_id in ENTRY_POINTS

    def __iter__(self) -> Iterator[str]:
        return iter(ENTRY_POINTS)

    def __len__(self) -> int:
        return len(ENTRY_POINTS)


@cache
def _load(env_id: str) -> EnvEntry:
    env = class_of(env_id)
    register(env_id, env, max_episode_steps=env.horizon_steps)
    return EnvEntry(id=env_id, env=env, horizon_steps=env.horizon_steps)


ENVS = Environments()

list(ENVS.values())  # register all with ManiSkill
