"""TP+SRL: task plans executed by trained skills, for the Home Assistant Benchmark (S 5, H).

Importing this package does not load the simulator; accessing an agent's factory does.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hab_tp_srl.factories import from_sensors, tp_srl

__all__ = ["from_sensors", "tp_srl"]


def __getattr__(name: str) -> Any:
    """Loads the factories, and with them the simulator, on first access."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("hab_tp_srl.factories"), name)


def __dir__() -> list[str]:
    """Lists the factories too, so that `hab-eval` can suggest them."""
    return sorted({*globals(), *__all__})
