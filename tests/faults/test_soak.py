"""Robustness of all environments to any action, in both datasets; see also `make soak`."""

import logging
import os

import pytest
from soak import soak

from hab_tasks.envs import ENVS

STEPS = int(os.environ.get("HAB_SOAK_STEPS", "10000"))
"""In all environments and datasets together."""

LONG_STEPS = 100_000
"""Growth of memory is looked at in runs of so many steps."""

MOST_GROWTH = 0.05
logger = logging.getLogger(__name__)
DATASETS = ("apartment", "replica_cad")

IN_CI = ("HabNavigate-v1", "HabPick-v1", "HabOpenFridge-v1")
"""Environments that CI plays in ReplicaCAD as well."""

pytestmark = pytest.mark.timeout(24 * 3600)

CASES = [
    pytest.param(
        env_id,
        dataset,
        marks=pytest.mark.slow if dataset == "apartment" or env_id in IN_CI else pytest.mark.long,
    )
    for env_id in ENVS
    for dataset in DATASETS
]


@pytest.mark.parametrize(("env_id", "dataset"), CASES)
def test_an_environment_stands_any_action(env_id, dataset, request):
    options = {}
    if dataset != "apartment":
        options = {
            "scene_dataset": str(request.getfixturevalue("replica_cad")),
            "objects": str(request.getfixturevalue("ycb")),
        }
    done = soak(env_id, options, STEPS // (len(ENVS) * len(DATASETS)), seed=0)
    logger.info("%s %s: %s, growth %.1f %%", env_id, dataset, done, 100.0 * done.growth)
    assert done.steps == STEPS // (len(ENVS) * len(DATASETS))
    if STEPS >= LONG_STEPS:
        assert done.growth <= MOST_GROWTH
