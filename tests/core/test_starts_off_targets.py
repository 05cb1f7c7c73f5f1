"""Start states: no object is within the hand's reach, and a released object misses its goal."""

import numpy as np
import pytest
from start_checks import SKILLS, TASKS, Replay

from hab_tasks.episodes.generators.furniture import handles_m
from hab_tasks.episodes.placing import falls_to
from hab_tasks.episodes.robot_start import HAND_CLEARANCE_M
from hab_tasks.geometry import apply

OPENING = [s for s in SKILLS if ("Open" in s or "Close" in s) and s != "HabCloseDrawer-v1"]


def cases(quick, *others):
    """One environment in the quick suite and one with real data, the others now and then."""
    real = [pytest.mark.assets]
    return pytest.mark.parametrize(
        ("env_id", "dataset"),
        [
            (quick, "apartment"),
            pytest.param(quick, "real", marks=[*real, pytest.mark.slow]),
            pytest.param("HabSetTable-v1", "apartment", marks=pytest.mark.slow),
            *(pytest.param(e, "apartment", marks=pytest.mark.long) for e in others[:-1]),
            *(pytest.param(e, "real", marks=[*real, pytest.mark.long]) for e in others),
        ],
    )


def gap_m(replay, points_m, axes=3):
    """From the hand to the nearest of points (K, 3), infinite without any."""
    return np.linalg.norm((points_m - replay.ee_m())[:, :axes], axis=1).min(initial=np.inf)


@cases("HabPick-v1", *TASKS)
def test_no_object_is_in_the_hands_reach(generated, dataset, env_id):
    source, episodes = generated(env_id, dataset)
    for replay in (Replay(source, episode) for episode in episodes):
        assert gap_m(replay, replay.sandbox.graspable_m()) >= HAND_CLEARANCE_M, replay.episode.id


@cases("HabCloseDrawer-v1", *OPENING, *TASKS)
def test_no_handle_is_in_the_hands_reach(generated, dataset, env_id):
    source, episodes = generated(env_id, dataset)
    for replay in (Replay(source, episode) for episode in episodes):
        assert gap_m(replay, handles_m(replay.sandbox)) >= HAND_CLEARANCE_M, replay.episode.id


@pytest.mark.parametrize(
    "dataset", ["apartment", pytest.param("real", marks=[pytest.mark.assets, pytest.mark.slow])]
)
def test_what_is_held_is_not_above_its_goal_and_does_not_get_there(generated, dataset):
    source, episodes = generated("HabPlace-v1", dataset)
    for replay in (Replay(source, episode) for episode in episodes):
        episode, sandbox = replay.episode, replay.sandbox
        (target,) = episode.targets
        goal_m = apply(target.world_from_goal, sandbox.com_in_object_m(target.object))
        assert gap_m(replay, goal_m[None], axes=2) >= HAND_CLEARANCE_M, episode.id
        assert not falls_to(sandbox, episode.robot, episode.held, goal_m), episode.id


def test_what_falls_onto_its_goal_is_seen(generated):
    source, episodes = generated("HabPlace-v1")
    replay = Replay(source, episodes[0])
    start_m = replay.sandbox.com_m(episodes[0].held)
    # It counts from 0.18 m on: below, once it fell by 2 cm; above, it falls away from it.
    for way_m, falls in ((-0.20, True), (0.20, False)):
        replay.stand()
        goal_m = start_m + np.array([0.0, 0.0, way_m])
        assert falls_to(replay.sandbox, episodes[0].robot, episodes[0].held, goal_m) == falls
