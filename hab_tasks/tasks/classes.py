"""Environment classes of all tasks, created from their declarations on first access.

Attribute names are the module that registers the task, a dot, and the environment id:
``getattr(classes, "hab_tasks.HabSetTable-v1")``. Gymnasium accepts such names in entry points.
"""

from __future__ import annotations

from functools import cache

from hab_tasks.registration import TASKS, imported_id
from hab_tasks.task_spec import TaskSpec
from hab_tasks.tasks.compile import compile_task
from hab_tasks.tasks.task_doc import docstring
from hab_tasks.tasks.task_env import TaskEnv


def __getattr__(name: str) -> type[TaskEnv]:
    """Returns the class of a task; imports the module that registers it."""
    module, _, env_id = name.rpartition(".")
    if not module or name.startswith("__"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return env_class(TASKS[imported_id(f"{module}:{env_id}")])


@cache
def env_class(spec: TaskSpec) -> type[TaskEnv]:
    """Returns the environment class of a task."""
    made = type(spec.class_name, (TaskEnv,), {"task": compile_task(spec), "__module__": __name__})
    made.__doc__ = docstring(spec, made.observation)
    return made
