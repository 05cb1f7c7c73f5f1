"""Overrides of a skill's weights and thresholds by name (S F.2 varies the force weight)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

from hab_tasks.errors import OptionError, UnknownNameError


def config_values(config: Any) -> dict[str, float]:
    """Returns the values of a configuration by name: ``weights.force``, ``force_limit_n``."""
    found: dict[str, float] = {}
    for field in fields(config):
        value = getattr(config, field.name)
        if is_dataclass(value):
            found |= {f"{field.name}.{name}": v for name, v in config_values(value).items()}
        else:
            found[field.name] = value
    return found


def configured(skill: str, config: Any, changes: Mapping[str, float]) -> Any:
    """Returns a configuration with overrides.

    Args:
        skill: Name of the skill, for messages.
        config: Its configuration, a frozen dataclass.
        changes: Name, as in `config_values` -> value.

    Raises:
        UnknownNameError: Unknown name.
        OptionError: A value is not a finite number from 0.
    """
    known = config_values(config)
    for name, value in changes.items():
        if name not in known:
            raise UnknownNameError(f"name in skill_config of {skill}", name, known)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not math.isfinite(value) or value < 0.0:
            option = f"skill_config {name!r} of {skill}"
            raise OptionError.of_value(option, value, "a finite number from 0")
        config = _with(config, name.split("."), float(value))
    return config


def _with(config: Any, path: list[str], value: float) -> Any:
    first, *rest = path
    return replace(config, **{first: _with(getattr(config, first), rest, value) if rest else value})
