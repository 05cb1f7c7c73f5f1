"""Starts several ranks on this machine with torchrun's elastic agent."""

from __future__ import annotations

import os
import sys
import uuid
from collections.abc import Sequence

from torch.distributed.elastic.multiprocessing.api import SignalException
from torch.distributed.elastic.multiprocessing.errors import ChildFailedError
from torch.distributed.launcher.api import LaunchConfig, elastic_launch

from hab_ppo.loopback import use_loopback
from hab_tasks.errors import RunStoppedError

MOST_RESTARTS = 3
PREPARED = "HAB_PPO_PREPARED"
"""Set for ranks whose output folder has been checked, and emptied, by their launcher."""


def is_rank() -> bool:
    """Whether this process is one of several ranks, started by torchrun."""
    return "WORLD_SIZE" in os.environ


def is_prepared() -> bool:
    """Whether this rank may continue what is in the output folder: it is of this very run."""
    return PREPARED in os.environ or os.environ.get("TORCHELASTIC_RESTART_COUNT", "0") != "0"


def launch(ranks: int, arguments: Sequence[str]) -> None:
    """Runs ``hab-ppo`` with these arguments in several ranks, restarted if one is killed.

    Raises:
        RunStoppedError: A rank failed.
    """
    os.environ[PREPARED] = "1"
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    config = LaunchConfig(
        min_nodes=1,
        max_nodes=1,
        nproc_per_node=ranks,
        run_id=uuid.uuid4().hex,
        rdzv_backend=use_loopback(),
        max_restarts=MOST_RESTARTS,
        monitor_interval=0.5,
    )
    try:
        elastic_launch(config, sys.executable)("-m", "hab_ppo", *arguments)
    except SignalException as error:  # Ctrl-C and SIGTERM, which the agent catches
        raise KeyboardInterrupt from error
    except ChildFailedError as error:
        rank, failure = error.get_first_failure()
        raise RunStoppedError(
            f"Rank {rank} ended with status {failure.exitcode}; its message is above. --resume "
            "continues from the last update."
        ) from error
    finally:
        del os.environ[PREPARED]
