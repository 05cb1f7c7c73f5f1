"""TP+SRL: task plans executed by trained skills, for the Home Assistant Benchmark (S 5, H).

Importing this package does not load the simulator; accessing an agent's factory does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hab_tasks.lazy_names import lazy_names

if TYPE_CHECKING:
    from hab_tp_srl.factories import from_sensors, tp_srl

__all__ = ["from_sensors", "tp_srl"]


__getattr__, __dir__ = lazy_names(__name__, {"factories": __all__})
