"""The studies by name, and the work of `hab-ppo study`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from hab_ppo.commands import StudyCommand
from hab_ppo.recipe import MOST_RANKS
from hab_ppo.studies.engine import run_study
from hab_ppo.studies.grad_cam import NAME, run_grad_cam
from hab_ppo.studies.learning import CURVES, MONOLITHIC, STOP
from hab_ppo.studies.left_counter import ACTIONS, DELAY, EFFICIENCY
from hab_ppo.studies.sensors import CAMERAS, SENSORS
from hab_ppo.studies.study import SCALES
from hab_tasks.errors import UnknownNameError
from hab_tasks.option_values import whole

DECLARED = (SENSORS, EFFICIENCY, CAMERAS, DELAY, ACTIONS, MONOLITHIC, STOP, CURVES)

STUDIES: dict[str, Callable[[StudyCommand], None]] = {
    NAME: run_grad_cam,
    **{one.name: partial(run_study, one) for one in DECLARED},
}
"""Name -> what runs the study."""


def run(options: StudyCommand) -> int:
    """Runs a study, or what is missing of it.

    Raises:
        UnknownNameError: Unknown study or scale.
    """
    if options.study not in STUDIES:
        raise UnknownNameError("study", options.study, STUDIES)
    if options.scale not in SCALES:
        raise UnknownNameError("scale", options.scale, SCALES)
    whole("--workers", options.workers, 1, MOST_RANKS)
    STUDIES[options.study](options)
    return 0
