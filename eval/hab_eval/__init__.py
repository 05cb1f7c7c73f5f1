"""Evaluation of agents on the Home Assistant Benchmark.

Importing this package loads neither torch nor the simulator: its names are imported when used.
"""

from typing import TYPE_CHECKING

from hab_tasks.registration import names_on_demand

if TYPE_CHECKING:
    from hab_eval.integrations.remote import remote
    from hab_eval.records.config import EvalConfig
    from hab_eval.records.results import RunRecord, read_record
    from hab_eval.run.agents import (
        close_hand,
        do_nothing,
        load_agent,
        open_hand,
        random_agent,
        straight_line,
    )
    from hab_eval.run.evaluate import RunOptions, evaluate

__all__ = [
    "EvalConfig",
    "RunOptions",
    "RunRecord",
    "__version__",
    "close_hand",
    "do_nothing",
    "evaluate",
    "load_agent",
    "open_hand",
    "random_agent",
    "read_record",
    "remote",
    "straight_line",
]

__version__ = "1.0.0"

__getattr__, __dir__ = names_on_demand(
    __name__,
    {
        "integrations.remote": ("remote",),
        "records.config": ("EvalConfig",),
        "records.results": ("RunRecord", "read_record"),
        "run.agents": (
            "close_hand",
            "do_nothing",
            "load_agent",
            "open_hand",
            "random_agent",
            "straight_line",
        ),
        "run.evaluate": ("RunOptions", "evaluate"),
    },
)
