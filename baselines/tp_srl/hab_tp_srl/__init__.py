"""TP+SRL: task plans executed by trained skills, for the Home Assistant Benchmark (S 5, H).

Importing this package does not load the simulator; accessing an agent's factory does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hab_tasks.registration import names_on_demand

if TYPE_CHECKING:
    from hab_tp_srl.factories import from_sensors, spa_from_sensors, tp_srl

__all__ = ["from_sensors", "spa_from_sensors", "tp_srl"]

__getattr__, __dir__ = names_on_demand(
    __name__, {"factories": ("from_sensors", "spa_from_sensors", "tp_srl")}
)
