"""Evaluation of agents on the Home Assistant Benchmark.

Importing this package loads neither torch nor the simulator: its names are imported when used.
"""

from typing import TYPE_CHECKING

from hab_tasks.lazy_names import lazy_names

if TYPE_CHECKING:
    from hab_eval.records.config import EvalConfig
    from hab_eval.records.results import RunRecord, read_record
    from hab_eval.run.agents import (
        close_hand,
        do_nothing,
        open_hand,
        random_agent,
        straight_line,
    )
    from hab_eval.run.evaluate import RunOptions, evaluate
    from hab_eval.run.load_agent import load_agent

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
    "straight_line",
]

__version__ = "0.3.0"

_MODULES = {
    "records.config": ("EvalConfig",),
    "records.results": ("RunRecord", "read_record"),
    "run.agents": ("close_hand", "do_nothing", "open_hand", "random_agent", "straight_line"),
    "run.evaluate": ("RunOptions", "evaluate"),
    "run.load_agent": ("load_agent",),
}


__getattr__, __dir__ = lazy_names(__name__, _MODULES)
