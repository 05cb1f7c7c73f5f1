"""Start states of the seven skills (S H.2), checked in an independent simulation."""

import math
from functools import partial

import numpy as np
import pytest
import start_checks as sc
from geodesics import geodesic_distance
from start_checks import SKILLS, TASKS, Replay

from hab_tasks.episodes.generators import base
from hab_tasks.episodes.robot_start import in_base_frame
from hab_tasks.errors import GenerationError
from hab_tasks.registration import ENTRY_POINTS
from hab_tasks.robots.fetch import FETCH
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.world.navigation import LayoutMaps, NavigationMap

REAL_IN_CI = ("HabPlace-v1", "HabOpenDrawer-v1", "HabNavigate-v1")


def real(env_id):
    tier = pytest.mark.slow if env_id in REAL_IN_CI else pytest.mark.long
    return pytest.param(env_id, "real", marks=[pytest.mark.assets, tier])


def templates(*episodes):
    return {handle.rsplit("_:", 1)[0] for episode in episodes for handle in episode.objects}


@pytest.mark.parametrize(
    ("env_id", "dataset"), [(s, "apartment") for s in SKILLS] + [real(s) for s in SKILLS]
)
def test_starts_are_those_of_the_protocol(generated, env_id, dataset):
    assert set(ENTRY_POINTS) == {*SKILLS, *TASKS}, "all are tested, here or with the tasks"
    source, episodes = generated(env_id, dataset)
    assert templates(*episodes) <= sc.SEEN
    for number, episode in enumerate(episodes):
        replay = Replay(source, episode)
        assert not replay.overlaps(episode.objects), episode.id
        if number == 0:
            assert replay.moved_m(replay.resting()) < 0.01, episode.id
            assert replay.joints_moved() < 0.01, episode.id
        assert not replay.touches(), episode.id
        # Places are drawn with this clearance; only then the noise comes on top.
        assert replay.off_floor_m(episode.robot.base) <= sc.BASE_NOISE_M + sc.CELL_M, episode.id
        arm = episode.robot.arm_pose(FETCH)
        assert ((arm >= FETCH.arm_lower_rad) & (arm <= FETCH.arm_upper_rad)).all()
        off = np.abs(ArmKinematics(FETCH).position(arm) - (0.5, 0.0, 1.0))
        # 5 cm of noise on each axis; the solver stops within 5 mm.
        assert (off <= 0.05 + 0.005).all(), episode.id
        CHECKS[env_id](replay, episode.robot.base)


def check_heading(replay, base, point_m):
    assert replay.heading_off_rad(base, point_m) <= math.radians(20.0) + 1e-6, replay.episode.id


# Pick and Place --------------------------------------------------------------------------------


def check_surface(replay, ref, others):
    """All objects lie on one receptacle, which is open."""
    replay.stand()
    for name in others:
        assert replay.stands_on(name, ref), (replay.episode.id, name)
    furniture = ref[1].partition("/")[0]
    if ref[0] == sc.FRIDGE:
        assert replay.episode.joints.keys() == {furniture}
        # Open far enough to reach in; how far depends on what stands beside it.
        assert 1.2 < replay.episode.joints[furniture]["top_door_hinge"] <= 2.35
    else:
        assert replay.episode.joints == {}


def check_facing(replay, base, point_m):
    """0.45 to 1.15 m away before 0.1 m of noise in x and in y."""
    check_heading(replay, base, point_m)
    gap = math.dist(base[:2], point_m[:2])
    assert 0.45 - sc.BASE_NOISE_M <= gap <= 1.15 + sc.BASE_NOISE_M, replay.episode.id


def check_pick(replay, base, names=sc.SIX):
    """Before one of six receptacles with the target and at most five others."""
    episode = replay.episode
    (target,) = episode.targets
    assert target.start[0] in names
    assert target.goal is target.world_from_goal is episode.held is episode.handle is None
    assert 1 <= len(episode.objects) <= 6
    check_surface(replay, target.start, episode.objects)
    check_facing(replay, base, replay.sandbox.com_m(target.object))


def check_place(replay, base, names=frozenset((*sc.SIX, sc.SINK))):
    """Before one of seven receptacles with the object in the hand; it stays at its goal."""
    episode = replay.episode
    (target,) = episode.targets
    assert target.goal[0] in names
    assert target.start is episode.handle is None
    assert episode.held == target.object
    check_surface(replay, target.goal, replay.resting())
    assert replay.moved_m(replay.at_goals()) < 0.01, episode.id
    assert not replay.overlaps(replay.at_goals()), episode.id
    # The solver of the arm's noise stops within 5 mm; poses are rounded to a micrometre.
    replay.stand()
    assert math.dist(replay.sandbox.com_m(episode.held), replay.ee_m()) < 1e-4
    replay.stand(replay.at_goals())
    assert replay.stands_on(target.object, target.goal)
    check_facing(replay, base, replay.sandbox.com_m(target.object))


# Doors and drawers -----------------------------------------------------------------------------


def check_fridge(replay, base, low_rad, high_rad):
    """The door in its range, before the robot."""
    episode = replay.episode
    fridge = episode.handle.furniture
    assert episode.handle.joint == "top_door_hinge"
    assert episode.joints.keys() <= {fridge}
    angle = episode.joints.get(fridge, {}).get("top_door_hinge", 0.0)
    assert low_rad <= angle <= high_rad, episode.id
    assert episode.targets[0].start == (sc.FRIDGE, f"{fridge}/body")
    replay.stand()
    assert replay.stands_on(episode.target, episode.targets[0].start)
    x, y = replay.in_frame(base, f"{fridge}/root")
    # 0.9 m x 1.2 m (S H.2), from 0.933 m on
    assert 0.933 <= x <= 1.833, episode.id
    assert -0.6 <= y <= 0.6, episode.id
    check_heading(replay, base, replay.marker_m())


def check_drawer(replay, base, low_share, high_share):
    """The drawer in its range, before the robot, others anywhere."""
    episode, sandbox = replay.episode, replay.sandbox
    counter, handle = episode.handle.furniture, episode.handle.joint
    assert episode.joints.keys() <= {counter}
    joints = {handle: 0.0} | episode.joints.get(counter, {})
    travel = {joint: sandbox.joint_limits(counter, joint)[1] for joint in joints}
    assert all(0.0 <= joints[joint] <= travel[joint] for joint in joints.keys() - {handle})
    low, high = (share * travel[handle] for share in (low_share, high_share))
    assert low - 1e-6 <= joints[handle] <= high + 1e-6, episode.id
    start = episode.targets[0].start
    assert start == (sc.DRAWER, f"{counter}/drawer3")
    replay.stand()
    assert replay.stands_on(episode.target, start)
    assert replay.over(sandbox.com_m(episode.target), start)[0] < 0.0
    check_heading(replay, base, replay.marker_m())
    x, y = replay.in_frame(base, start[1])
    # 0.15 m x 0.75 m (S H.2); the handle is 0.3 m ahead of the drawer. To open it, 0.8 m before the
    # handle, and so that the handle, opened by 90 %, is in the workspace; to close it, 0.5 m.
    nearest_m = 0.8 if low_share else 1.1
    assert nearest_m <= x <= nearest_m + 0.15, episode.id
    assert -0.375 <= y <= 0.375, episode.id
    if not low_share:
        sandbox.set_joint(counter, handle, 0.9 * travel[handle])
        end_m = in_base_frame(base, replay.marker_m())
        assert ((end_m >= (0.4, -0.7, 0.25)) & (end_m <= (1.2, 0.7, 1.5))).all(), episode.id
        sandbox.set_joint(counter, handle, 0.0)


def test_a_random_subset_of_the_other_drawers_is_open(generated):
    for env_id in ("HabOpenDrawer-v1", "HabCloseDrawer-v1"):
        _, episodes = generated(env_id, "apartment")
        opened = [
            episode.joints.get(episode.handle.furniture, {}).keys() - {episode.handle.joint}
            for episode in episodes
        ]
        assert len(set(map(frozenset, opened))) > 1, env_id
        # Six others, each open with probability 1/2: not all the same way.
        assert 0 < sum(map(len, opened)) < 6 * len(episodes), env_id


# Navigate --------------------------------------------------------------------------------------


def check_navigate(replay, base):
    """From the free floor to a start of another skill, on the map that measures the way."""
    episode = replay.episode
    goal = episode.navigation
    CHECKS[goal.skill](replay, goal.base)
    straight_m = math.dist(goal.base[:2], base[:2])
    assert straight_m >= 1.0
    assert replay.off_floor_m(base) < 1e-5, "it starts off the free floor"
    map_ = LayoutMaps(lambda _: replay.sandbox.spec).of(episode.scene_id, episode.joints)
    start_m, goal_m = np.array(base[:2]), np.array(goal.base[:2])
    assert map_.is_free(np.array((start_m, goal_m))).all(), episode.id
    way_m = geodesic_distance(map_, start_m, map_.geodesic_field(goal_m))
    # Fronts on cells of 5 cm are short by some per cent.
    assert 0.95 * straight_m <= way_m < math.inf, episode.id


CHECKS = {
    "HabPick-v1": check_pick,
    "HabPlace-v1": check_place,
    "HabOpenFridge-v1": partial(check_fridge, low_rad=0.0, high_rad=0.0),
    "HabCloseFridge-v1": partial(check_fridge, low_rad=math.pi / 4, high_rad=2 * math.pi / 3),
    "HabOpenDrawer-v1": partial(check_drawer, low_share=0.0, high_share=0.0),
    "HabCloseDrawer-v1": partial(check_drawer, low_share=0.8, high_share=1.0),
    "HabNavigate-v1": check_navigate,
}


def test_a_goal_that_the_map_parts_from_its_start_is_refused(generated, monkeypatch):
    """With a map on which nothing is free no candidate is left, and the message says why."""
    source, _ = generated("HabNavigate-v1", "apartment")
    monkeypatch.setattr(NavigationMap, "is_free", lambda _, at_m: np.zeros(len(at_m), dtype=bool))
    monkeypatch.setattr(base, "ATTEMPTS", 3)
    monkeypatch.setattr(base, "LAYOUTS", 1)
    with pytest.raises(GenerationError, match="no way from the start to the goal"):
        source.make(0)


# Furnished layouts -----------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    "dataset", ["apartment", pytest.param("real", marks=[pytest.mark.assets, pytest.mark.long])]
)
def test_a_furnished_layouts_loose_objects_start_settled(generated, dataset):
    """In a simulation of its own: they are where they settle, and stay there beside the others."""
    source, (episode, *_) = generated("HabPick-v1", dataset, scene="apt_0")
    replay = Replay(source, episode)
    assert len(episode.loose) >= 90
    assert episode.loose.keys() == {o.name for o in replay.sandbox.spec.objects if o.dynamic}
    for name, pose in episode.loose.items():
        assert math.dist(replay.sandbox.settled[name][:3], pose[:3]) < 1e-4, name
    everything = {**episode.loose, **episode.objects}
    replay.stand()
    replay.sandbox.settle(2.0, tuple(everything))
    moved = {n: math.dist(replay.sandbox.pose(n)[:3], p[:3]) for n, p in everything.items()}
    assert not {name: way for name, way in moved.items() if way > 0.01}


# What is kept for evaluation -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("env_id", "novel"),
    [
        ("HabPick-v1", "objects"),
        ("HabPick-v1", "receptacles"),
        pytest.param("HabPlace-v1", "receptacles", marks=pytest.mark.slow),
        *(pytest.param(s, "objects", marks=pytest.mark.long) for s in SKILLS if s != "HabPick-v1"),
    ],
)
def test_what_is_novel_is_what_is_kept_for_evaluation(generated, env_id, novel):
    source, episodes = generated(env_id, "apartment", novel)
    names = templates(*episodes)
    assert names
    assert names <= (sc.UNSEEN if novel == "objects" else sc.SEEN)
    for episode in episodes if novel == "receptacles" else ():
        kept = {sc.TABLE_DARK, sc.CHAIR, *sc.SHELVES}
        CHECKS[env_id](Replay(source, episode), episode.robot.base, kept)
