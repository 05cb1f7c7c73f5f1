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

IN_CI = ("HabNavigate-v1", "HabPick-v1", "HabOpenFridge-v1")
"""Environments that CI plays in ReplicaCAD as well."""

pytestmark = pytest.mark.timeout(24 * 3600)

CASES = [pytest.param(env_id, "apartment", marks=pytest.mark.slow) for env_id in ENVS]
for env_id in ENVS:
    mark = pytest.mark.slow if env_id in IN_CI else pytest.mark.long
    CASES.append(pytest.param(env_id, "replica_cad", marks=mark))


@pytest.mark.parametrize(("env_id", "dataset"), CASES)
def test_an_environment_stands_any_action(env_id, dataset, request):
    options = {}
    if dataset == "replica_cad":
        folders = {"scene_dataset": "replica_cad", "objects": "ycb"}
        options = {k: str(request.getfixturevalue(name)) for k, name in folders.items()}
    done = soak(env_id, options, STEPS // len(CASES), seed=0)
    logger.info("%s %s: %s, growth %.1f %%", env_id, dataset, done, 100.0 * done.growth)
    assert done.steps == STEPS // len(CASES)
    if STEPS >= LONG_STEPS:
        assert done.growth <= MOST_GROWTH
