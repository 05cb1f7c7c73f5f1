"""Loads agents by ``module:factory``. The evaluator does not depend on any baseline."""

from __future__ import annotations

import difflib
import importlib
import inspect
import pkgutil
import sys
from collections.abc import Callable
from importlib import metadata
from types import ModuleType
from typing import Any

from hab_eval.errors import AgentError
from hab_eval.records.agent_files import search_here
from hab_eval.run.agent_checks import check_agent, loading
from hab_tasks.agent import Agent, AgentSetup
from hab_tasks.errors import UnknownNameError


def load_agent(reference: str, setup: AgentSetup) -> Agent:
    """Imports ``module:factory`` and calls the factory.

    Raises:
        UnknownNameError: The module has no such factory.
        AgentError: The reference is malformed, the module is not found or cannot be imported, the
            factory raises, or its return value is not an `Agent`.
        RunStoppedError: The module or the factory calls `sys.exit`.
    """
    module_name, colon, factory_name = reference.partition(":")
    if not (colon and module_name and factory_name):
        raise AgentError(
            f"Agent {reference!r} is not of the form module:factory, e.g. hab_eval:random_agent."
        )
    with loading(f"Agent module {module_name!r}"):
        module = _import(module_name)
        factory = getattr(module, factory_name, None)
        if not callable(factory):
            raise UnknownNameError(f"agent in {module_name}", factory_name, _factories(module))
    with loading(f"The factory of agent {reference!r}"):
        return check_agent(factory(setup), reference)


def _import(name: str) -> ModuleType:
    """Imports an agent's module from the working directory or the installed packages."""
    here = search_here()
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        missing = error.name or ""
        if name == missing or name.startswith(f"{missing}."):
            raise AgentError(_not_found(name, missing, here)) from error
        raise AgentError(
            f"Agent module {name!r} needs {missing!r}, which is not installed."
        ) from error
    except ImportError as error:
        raise AgentError(f"Agent module {name!r} cannot be imported: {error}") from error


def _not_found(name: str, missing: str, here: str) -> str:
    """Returns a message with the searched paths and the nearest module name."""
    parent, _, last = missing.rpartition(".")
    if parent:
        folders = getattr(sys.modules.get(parent), "__path__", [])  # [] if it is not a package
        names = {module.name for module in pkgutil.iter_modules(folders)}
        where = f"in the package {parent!r}"
    else:
        names = {module.name for module in pkgutil.iter_modules()}
        names |= metadata.packages_distributions().keys()  # iter_modules lacks editable installs
        where = f"in the working directory ({here}) nor among the installed packages"
    near = difflib.get_close_matches(last, names, n=1)
    hint = f" Did you mean {f'{parent}.{near[0]}'.lstrip('.')!r}?" if near else ""
    return f"Agent module {name!r} is {'not' if parent else 'neither'} {where}.{hint}"


def _factories(module: ModuleType) -> list[str]:
    """Returns a module's public callables whose only required argument is an `AgentSetup`."""
    members = ((name, getattr(module, name)) for name in dir(module) if not name.startswith("_"))
    return [name for name, value in members if callable(value) and _takes_setup(value)]


def _takes_setup(factory: Callable[..., Any]) -> bool:
    try:
        parameters = inspect.signature(factory).parameters.values()
    except (TypeError, ValueError):
        return False  # a built-in without a signature
    needed = [p for p in parameters if p.default is p.empty]
    return len(needed) == 1 and "AgentSetup" in str(needed[0].annotation)
