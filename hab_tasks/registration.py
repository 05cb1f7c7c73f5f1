"""Registers the environments with Gymnasium by name, without importing them.

Making an environment imports its class, in this process or in a worker of `gymnasium.make_vec`.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import WrapperSpec

from hab_tasks.constants import NAVIGATE_HORIZON_STEPS, SKILL_HORIZON_STEPS
from hab_tasks.errors import HabError, UnknownNameError
from hab_tasks.receptacles import CONTAINERS
from hab_tasks.task_spec import TaskSpec, TaskSpecError

PACKAGE = "hab_tasks"
VECTOR_ENTRY_POINTS = f"{PACKAGE}.vector"
"""Module with one entry point of `gymnasium.make_vec` for each environment."""

TASK_CLASSES = f"{PACKAGE}.tasks.task_env"
"""Module that creates the classes of tasks on first access."""

MAIN = "__main__"
"""Module of the script, or of the notebook."""

TAKEN = "another environment has this id; choose another one."

SKILLS: dict[str, tuple[str, int]] = {
    "HabPick-v1": ("hab_tasks.skills.pick:HabPickEnv", SKILL_HORIZON_STEPS),
    "HabPlace-v1": ("hab_tasks.skills.place:HabPlaceEnv", SKILL_HORIZON_STEPS),
    "HabOpenFridge-v1": ("hab_tasks.skills.open_fridge:HabOpenFridgeEnv", SKILL_HORIZON_STEPS),
    "HabCloseFridge-v1": ("hab_tasks.skills.close_fridge:HabCloseFridgeEnv", SKILL_HORIZON_STEPS),
    "HabOpenDrawer-v1": ("hab_tasks.skills.open_drawer:HabOpenDrawerEnv", SKILL_HORIZON_STEPS),
    "HabCloseDrawer-v1": ("hab_tasks.skills.close_drawer:HabCloseDrawerEnv", SKILL_HORIZON_STEPS),
    "HabNavigate-v1": ("hab_tasks.skills.navigate:HabNavigateEnv", NAVIGATE_HORIZON_STEPS),
}
"""Id -> entry point and `horizon_steps`, the maximum episode length."""

ENTRY_POINTS: dict[str, str] = {}
"""Environment id -> entry point of its class."""

TASK_SKILLS: dict[str, str] = {}
"""Skill of tasks -> environment id, for the skills of other packages."""

TASKS: dict[str, TaskSpec] = {}
"""Task id -> declaration."""

_modules: dict[str, str] = {}
"""Id -> module that registers it on import."""


def names_on_demand(
    package: str, modules: Mapping[str, Collection[str]]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Returns ``__getattr__`` and ``__dir__`` of a package that imports its names when used.

    `modules`: module, relative to the package -> public names.
    """
    found = {name: module for module, names in modules.items() for name in names}

    def load(name: str) -> Any:
        if name not in found:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(importlib.import_module(f"{package}.{found[name]}"), name)

    return load, lambda: sorted({*vars(sys.modules[package]), *found})


def register_skills() -> None:
    """Adds the skills to Gymnasium's registry."""
    for env_id, (entry_point, horizon_steps) in SKILLS.items():
        _register(env_id, entry_point, horizon_steps, PACKAGE)


def register_skill(
    env_id: str,
    entry_point: str,
    horizon_steps: int,
    *,
    in_tasks: str | None = None,
    behind: Collection[str] = (),
) -> None:
    """Adds a user-defined skill to Gymnasium's registry.

    Call it on import of the class's module or package. ``gym.make("module:X-v1")`` then works
    anywhere, including worker processes and every command. Navigate only uses the benchmark's
    skills.

    Args:
        env_id: Environment id, ``X-v1``.
        entry_point: ``module:Class`` of its `hab_tasks.engine.skill_env.SkillEnv`.
        horizon_steps: Maximum episode length, equal to the skill's.
        in_tasks: Name of the skill in tasks, ``open_x`` or ``close_x`` of a door or drawer ``x``;
            its module adds the kind with `hab_tasks.articulations.add_kind`.
        behind: Receptacles for which a task has to open ``x`` (`hab_tasks.receptacles`).

    Raises:
        HabError: The id is taken, or a receptacle is behind another door.
    """
    if ENTRY_POINTS.get(env_id, entry_point) != entry_point or _is_foreign(env_id):
        raise HabError(f"{env_id}: {TAKEN}")
    if in_tasks is not None:
        TASK_SKILLS[in_tasks] = env_id
        door = in_tasks.partition("_")[2]
        for name in behind:
            if CONTAINERS.setdefault(name, door) != door:
                words = f"behind {CONTAINERS[name]}; it cannot be behind {door} too."
                raise HabError(f"{name} is {words}")
    _register(env_id, entry_point, horizon_steps, entry_point.partition(":")[0])


def register_task(spec: TaskSpec, module: str) -> None:
    """Adds a task to Gymnasium's registry, and makes it known to planners and commands.

    Call it on import of a module. ``gym.make("module:X-v1")`` then works anywhere, including
    worker processes and every command.

    Args:
        spec: The task.
        module: The module that calls this, ``__name__``.

    Raises:
        TaskSpecError: The id is taken, or `spec` is not a task.
    """
    if not isinstance(spec, TaskSpec):
        raise TaskSpecError(f"register_task: a TaskSpec is valid, not a {type(spec).__name__}.")
    if TASKS.get(spec.id) == spec:
        return
    if spec.id in ENTRY_POINTS or _is_foreign(spec.id):
        raise TaskSpecError(f"{spec.id}: {TAKEN}")
    TASKS[spec.id] = spec
    # The entry point names the module to import, as worker processes only get this string.
    _register(spec.id, f"{TASK_CLASSES}:{module}.{spec.id}", spec.horizon_steps, module)


def _register(env_id: str, entry_point: str, horizon_steps: int, module: str) -> None:
    """Registers with ManiSkill's time limit, without importing the class."""
    ENTRY_POINTS[env_id], _modules[env_id] = entry_point, module
    limit = WrapperSpec(
        "MSTimeLimit",
        entry_point="mani_skill.utils.registration:TimeLimitWrapper",
        kwargs={"max_episode_steps": horizon_steps},
    )
    gym.register(
        env_id,
        entry_point=entry_point,
        max_episode_steps=horizon_steps,
        disable_env_checker=True,  # it rejects tensors, which ManiSkill's observations are
        additional_wrappers=_OfSingleEnvs((limit,)),
        vector_entry_point=f"{VECTOR_ENTRY_POINTS}:{module}.{env_id}",
    )


def _is_foreign(env_id: str) -> bool:
    """Whether an id belongs to an environment of Gymnasium or of another package."""
    known = gym.registry.get(env_id)
    return known is not None and not str(known.vector_entry_point).startswith(VECTOR_ENTRY_POINTS)


def declared_here(env_id: str) -> TaskSpec | None:
    """Returns a task that the main script declares; workers may not get there when they import it.

    None for all other environments, which their modules register.
    """
    return TASKS.get(env_id) if _modules.get(env_id) == MAIN else None


class _OfSingleEnvs(tuple[WrapperSpec, ...]):
    """Wrappers that `gymnasium.make` applies and `gymnasium.make_vec` does not see.

    Gymnasium refuses the vector entry point of an environment with wrappers. This one's only
    wrapper is the time limit, which the vector environment applies itself.
    """

    def __len__(self) -> int:
        return 0


def imported_id(reference: str) -> str:
    """Imports the module in ``module:X-v1``, if any, and returns the id.

    The module may also be in the working directory.

    Raises:
        HabError: The module cannot be imported.
        UnknownNameError: Unknown environment id.
    """
    module, _, env_id = reference.rpartition(":")
    if module and env_id not in ENTRY_POINTS:
        _import(module, reference)
    if env_id not in ENTRY_POINTS:
        raise UnknownNameError("environment", reference, ENTRY_POINTS)
    return env_id


def class_of(env_id: str) -> Any:
    """Imports and returns the class of an environment."""
    module, _, name = ENTRY_POINTS[env_id].partition(":")
    return getattr(importlib.import_module(module), name)


def registered_id(env: Any) -> str:
    """Returns the id of an environment class.

    Raises:
        HabError: The class is not registered.
    """
    env_id, name = env.default_id(), env.__qualname__
    if env_id not in ENTRY_POINTS:
        raise HabError(
            f"{name} is not registered; call hab_tasks.register_skill({env_id!r}, "
            f"'{env.__module__}:{name}', horizon_steps={env.horizon_steps}) before making one."
        )
    return env_id


def reference_of(env_id: str) -> str:
    """Returns ``module:X-v1``, which `gym.make` accepts without a prior import."""
    module = _modules[env_id]
    return env_id if module == MAIN else f"{module}:{env_id}"


def _import(module: str, reference: str) -> None:
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)  # last, so that local files do not shadow libraries
        importlib.invalidate_caches()
    try:
        importlib.import_module(module)
    except HabError:
        raise
    except (Exception, SystemExit) as error:
        raise HabError(
            f"Environment {reference!r}: module {module!r} cannot be imported "
            f"({type(error).__name__}: {error})."
        ) from error
