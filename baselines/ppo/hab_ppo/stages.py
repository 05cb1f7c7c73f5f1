"""Stages of a task, which the runs of MonolithicRL report (S App. I.2, Fig. 26)."""

from __future__ import annotations

from hab_ppo.recipe import EnvConfig
from hab_tasks.envs import ENVS
from hab_tasks.registration import imported_id
from hab_tasks.tasks.task_env import TaskEnv


def stage_names(env: EnvConfig) -> tuple[str, ...]:
    """Returns the names of a task's stages, in order; () for a skill."""
    found = ENVS[imported_id(env.reference)].env
    return tuple(found.task.stages) if issubclass(found, TaskEnv) else ()


def info_keys(env: EnvConfig) -> tuple[str, ...]:
    """Returns the entries of `info` that a run needs."""
    return ("success", "stages") if stage_names(env) else ("success",)
