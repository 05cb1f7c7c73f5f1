"""Registration of a skill's PDDL action and of its provider, for other packages.

Registering imports nothing; call it on import of a module, beside `hab_tasks.register_skill`.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hab_plans.errors import PlannerError

if TYPE_CHECKING:
    from hab_tasks.agent import AgentSetup

ACTIONS: dict[str, str] = {}
"""Name of a registered action -> PDDL."""

ACTION_OF: dict[str, str] = {}
"""Skill of tasks -> the registered action that it carries out."""

PROVIDERS: dict[str, str] = {}
"""Skill of tasks -> ``module:factory`` of its provider."""

_ACTION = re.compile(r"\(:action\s+([\w-]+)")


def register_action(pddl: str, skill: str) -> None:
    """Adds an action to the planning domain (``domain.pddl``).

    Args:
        pddl: ``(:action open-x :parameters (?z - container) ...)``; its first parameter is what the
            skill is about.
        skill: Name of the skill in tasks, e.g. ``open_x``.

    Raises:
        PlannerError: Not one action, or another one has this name.
    """
    names = _ACTION.findall(pddl)
    if len(names) != 1 or ACTIONS.get(names[0], pddl) != pddl:
        raise PlannerError(f"Action of {skill}: one (:action NAME ...) with a new name is valid.")
    ACTIONS[names[0]], ACTION_OF[skill] = pddl, names[0]


def register_provider(skill: str, factory: str) -> None:
    """Makes agents that execute plans use a provider for a skill.

    Args:
        skill: Name of the skill in tasks.
        factory: ``module:factory``; called with the agent's `AgentSetup`, it returns a
            `SkillProvider`, or an `Agent` of the skill's environment.
    """
    PROVIDERS[skill] = factory


def load_factory(reference: str) -> Callable[[AgentSetup], Any]:
    """Returns the factory ``module:factory`` of a provider."""
    module, _, name = reference.partition(":")
    return getattr(importlib.import_module(module), name)
