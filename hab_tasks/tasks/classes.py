"""Environment classes of all tasks, created from their declarations on first access.

Attribute names are the module that registers the task, a dot, and the environment id:
``getattr(classes, "hab_tasks.HabSetTable-v1")``. Gymnasium accepts such names in entry points.
"""

from __future__ import annotations

from functools import cache

from mani_skill.utils.registration import REGISTERED_ENVS

from hab_tasks.registration import TAKEN, TASKS, imported_id
from hab_tasks.task_spec import TaskSpec, TaskSpecError
from hab_tasks.tasks.compile import compile_task
from hab_tasks.tasks.task_doc import docstring
from hab_tasks.tasks.task_env import TaskEnv


def __getattr__(name: str) -> type[TaskEnv]:
    """Returns the class of a task; imports the module that registers it."""
    module, _, env_id = name.rpartition(".")
    if not module:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    spec = TASKS[imported_id(f"{module}:{env_id}")]
    known = REGISTERED_ENVS.get(env_id)
    if known is not None and not issubclass(known.cls, TaskEnv):
        raise TaskSpecError(f"{env_id}: {TAKEN}")  # ManiSkill has registered its own meanwhile
    return env_class(spec)


@cache
def env_class(spec: TaskSpec) -> type[TaskEnv]:
    """Returns the environment class of a task."""
    made = type(spec.class_name, (TaskEnv,), {"task": compile_task(spec), "__module__": __name__})
    made.__doc__ = docstring(spec, made.observation)
    return made
