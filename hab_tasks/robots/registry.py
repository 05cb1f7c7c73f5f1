"""The robots of the environments, by ManiSkill's robot uid."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from hab_tasks.errors import UnknownNameError
from hab_tasks.robots.spec import RobotSpec

_robots: dict[str, tuple[RobotSpec, str]] = {}
"""Uid -> specification, and ``module:Class`` of the agent."""


def register_robot(spec: RobotSpec, agent: str) -> None:
    """Makes a robot known; `agent` is ``module:Class`` of its `MobileManipulator`."""
    _robots[spec.uid] = spec, agent


def robot_of(uid: str) -> RobotSpec:
    """Returns the specification of a robot.

    Raises:
        UnknownNameError: No such robot is registered.
    """
    if uid not in _robots:
        raise UnknownNameError("robot_uids", uid, list(_robots))
    return _robots[uid][0]


def agent_class(spec: RobotSpec) -> Any:
    """Imports and returns the class of a robot's ManiSkill agent."""
    module, _, name = _robots[spec.uid][1].partition(":")
    return getattr(import_module(module), name)
