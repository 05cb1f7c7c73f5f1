"""Start states of the seven skills (S H.2), checked in an independent simulation."""

import math

import numpy as np
import pytest
import start_checks as sc
from geodesics import geodesic_distance
from start_checks import SKILLS, TASKS, Replay

from hab_tasks.episodes.generators import base
from hab_tasks.episodes.robot_start import in_base_frame
from hab_tasks.errors import GenerationError
from hab_tasks.navigation import LayoutMaps, NavigationMap
from hab_tasks.registration import ENTRY_POINTS
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.robots.robot import ROBOT

REAL = pytest.param("real", marks=[pytest.mark.assets, pytest.mark.slow])
QUICK = ("HabPick-v1", "HabCloseDrawer-v1")
every_skill = pytest.mark.parametrize(
    "env_id", [s if s in QUICK else pytest.param(s, marks=pytest.mark.slow) for s in SKILLS]
)
every_dataset = pytest.mark.parametrize("dataset", ["apartment", REAL])


@pytest.fixture
def replays(generated, dataset, env_id):
    """The env's episodes, each in its layout again."""
    source, episodes = generated(env_id, dataset)
    return (Replay(source, episode) for episode in episodes)


def test_every_generator_is_tested_here_or_with_the_tasks():
    assert set(ENTRY_POINTS) == {*SKILLS, *TASKS}


# All skills ------------------------------------------------------------------------------------


@every_dataset
@every_skill
def test_objects_rest_and_nothing_overlaps(replays):
    for replay in replays:
        assert replay.moved_m(replay.resting()) < 0.01, replay.episode.id
        assert not replay.overlaps(replay.episode.objects), replay.episode.id
        assert replay.joints_moved() < 0.01, replay.episode.id


@every_dataset
@every_skill
def test_the_robot_stands_free(replays):
    for replay in replays:
        base = replay.episode.robot.base
        assert not replay.touches(), replay.episode.id
        # Places are drawn with this clearance; only then the noise comes on top.
        assert replay.off_floor_m(base) <= sc.BASE_NOISE_M + sc.CELL_M, replay.episode.id


@every_dataset
@every_skill
def test_the_hand_starts_near_rest(replays):
    for replay in replays:
        arm = np.array(replay.episode.robot.arm_qpos_rad)
        assert (arm >= ROBOT.arm_lower_rad).all()
        assert (arm <= ROBOT.arm_upper_rad).all()
        off = np.abs(ArmKinematics().position(arm) - (0.5, 0.0, 1.0))
        # 5 cm of noise on each axis; the solver stops within 5 mm.
        assert (off <= 0.05 + 0.005).all(), replay.episode.id


@every_dataset
@every_skill
def test_objects_are_those_of_training(replays):
    for replay in replays:
        assert {handle.rsplit("_:", 1)[0] for handle in replay.episode.objects} <= sc.SEEN


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
    """Turned by 20 degrees at most; 0.45 to 1.15 m away before 0.1 m of noise in x and in y."""
    assert replay.heading_off_rad(base, point_m) <= math.radians(20.0) + 1e-6, replay.episode.id
    gap = math.dist(base[:2], point_m[:2])
    assert 0.45 - sc.BASE_NOISE_M <= gap <= 1.15 + sc.BASE_NOISE_M, replay.episode.id


def check_pick(replay, base, names=sc.SIX):
    episode = replay.episode
    (target,) = episode.targets
    assert target.start[0] in names
    assert target.goal is target.world_from_goal is episode.held is episode.handle is None
    assert 1 <= len(episode.objects) <= 6  # the target and at most five others
    check_surface(replay, target.start, episode.objects)
    check_facing(replay, base, replay.sandbox.com_m(target.object))


def check_place(replay, base, names=frozenset((*sc.SIX, sc.SINK))):
    episode = replay.episode
    (target,) = episode.targets
    assert target.goal[0] in names
    assert target.start is episode.handle is None
    assert episode.held == target.object
    check_surface(replay, target.goal, replay.resting())
    # The solver of the arm's noise stops within 5 mm; poses are rounded to a micrometre.
    replay.stand()
    assert math.dist(replay.sandbox.com_m(episode.held), replay.ee_m()) < 1e-4
    replay.stand(replay.at_goals())
    assert replay.stands_on(target.object, target.goal)
    check_facing(replay, base, replay.sandbox.com_m(target.object))


@every_dataset
@pytest.mark.parametrize("env_id", ["HabPick-v1"])
def test_pick_starts_before_one_of_six_receptacles(replays):
    for replay in replays:
        check_pick(replay, replay.episode.robot.base)


@every_dataset
@pytest.mark.parametrize("env_id", ["HabPlace-v1"])
def test_place_starts_before_one_of_seven_with_the_object_in_the_hand(replays):
    for replay in replays:
        check_place(replay, replay.episode.robot.base)


@every_dataset
@pytest.mark.parametrize("env_id", ["HabPlace-v1"])
def test_an_object_stays_at_its_goal(replays):
    for replay in replays:
        assert replay.moved_m(replay.at_goals()) < 0.01, replay.episode.id
        assert not replay.overlaps(replay.at_goals()), replay.episode.id


@pytest.mark.parametrize("env_id", ["HabPick-v1", "HabPlace-v1"])
def test_starts_vary(generated, env_id):
    _, episodes = generated(env_id, "apartment")
    assert len({e.target for e in episodes}) >= 3
    assert len({e.targets[0].start or e.targets[0].goal for e in episodes}) >= 2
    assert len({e.robot for e in episodes}) == len({e.seed for e in episodes}) == len(episodes)


# Doors and drawers -----------------------------------------------------------------------------


def check_fridge(replay, base, low_rad, high_rad):
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
    assert replay.heading_off_rad(base, replay.marker_m()) <= math.radians(20.0) + 1e-6


def check_drawer(replay, base, low_share, high_share):
    episode = replay.episode
    counter = episode.handle.furniture
    assert episode.joints.keys() <= {counter}
    for joint, value in episode.joints.get(counter, {}).items():
        if joint != episode.handle.joint:
            assert 0.0 <= value <= replay.sandbox.joint_limits(counter, joint)[1]
    travel = replay.sandbox.joint_limits(counter, episode.handle.joint)[1]
    position = episode.joints.get(counter, {}).get(episode.handle.joint, 0.0)
    assert low_share * travel - 1e-6 <= position <= high_share * travel + 1e-6, episode.id
    drawer = f"{counter}/drawer3"
    assert episode.targets[0].start == (sc.DRAWER, drawer)
    replay.stand()
    assert replay.stands_on(episode.target, episode.targets[0].start)
    assert replay.over(replay.sandbox.com_m(episode.target), episode.targets[0].start)[0] < 0.0
    x, y = replay.in_frame(base, drawer)
    # 0.15 m x 0.75 m (S H.2); the handle is 0.3 m ahead of the drawer. To open it, 0.8 m before the
    # handle, and so that the handle, opened by 90 %, is in the workspace; to close it, 0.5 m.
    nearest_m = 0.8 if low_share else 1.1
    assert nearest_m <= x <= nearest_m + 0.15, episode.id
    if not low_share:
        end_m = opened_m(replay, 0.9 * travel)
        assert (in_base_frame(base, end_m) >= (0.4, -0.7, 0.25)).all(), episode.id
        assert (in_base_frame(base, end_m) <= (1.2, 0.7, 1.5)).all(), episode.id
    assert -0.375 <= y <= 0.375, episode.id
    assert replay.heading_off_rad(base, replay.marker_m()) <= math.radians(20.0) + 1e-6


def opened_m(replay, position):
    """The handle's place (3,) with the drawer at a position [m]."""
    handle = replay.episode.handle
    replay.sandbox.set_joint(handle.furniture, handle.joint, position)
    place_m = replay.marker_m()
    replay.sandbox.set_joint(handle.furniture, handle.joint, 0.0)
    return place_m


DOORS = {
    "HabOpenFridge-v1": (check_fridge, 0.0, 0.0),
    "HabCloseFridge-v1": (check_fridge, math.pi / 4, 2 * math.pi / 3),
    "HabOpenDrawer-v1": (check_drawer, 0.0, 0.0),
    "HabCloseDrawer-v1": (check_drawer, 0.8, 1.0),
}


@every_dataset
@pytest.mark.parametrize("env_id", DOORS)
def test_doors_and_drawers_start_in_their_range_before_the_robot(replays, env_id):
    check, low, high = DOORS[env_id]
    for replay in replays:
        check(replay, replay.episode.robot.base, low, high)


@pytest.mark.parametrize("env_id", ["HabOpenDrawer-v1", "HabCloseDrawer-v1"])
def test_a_random_subset_of_the_other_drawers_is_open(generated, env_id):
    _, episodes = generated(env_id, "apartment")
    subsets = set()
    for episode in episodes:
        joints = episode.joints.get(episode.handle.furniture, {})
        subsets.add(frozenset(joints) - {episode.handle.joint})
    assert len(subsets) > 1
    # Six others, each open with probability 1/2: all of them the same way is out of the question.
    assert 0 < sum(map(len, subsets)) < 6 * len(episodes)


# Navigate --------------------------------------------------------------------------------------

CHECKS = {"HabPick-v1": (check_pick,), "HabPlace-v1": (check_place,), **DOORS}


@every_dataset
@pytest.mark.parametrize("env_id", ["HabNavigate-v1"])
def test_navigate_goes_to_a_start_of_another_skill(replays):
    for replay in replays:
        goal, start = replay.episode.navigation, replay.episode.robot.base
        check, *limits = CHECKS[goal.skill]
        check(replay, goal.base, *limits)
        assert math.dist(goal.base[:2], start[:2]) >= 1.0
        assert replay.off_floor_m(start) < 1e-5, "it starts off the free floor"


@every_dataset
@pytest.mark.parametrize("env_id", ["HabNavigate-v1"])
def test_navigates_ends_are_free_on_the_map_that_measures_the_way(generated, dataset, env_id):
    source, episodes = generated(env_id, dataset)
    maps = LayoutMaps(source.scene)
    for episode in episodes:
        map_ = maps.of(episode.scene_id, episode.joints)
        start_m, goal_m = np.array(episode.robot.base[:2]), np.array(episode.navigation.base[:2])
        assert map_.is_free(np.array((start_m, goal_m))).all(), episode.id
        way_m = geodesic_distance(map_, start_m, map_.geodesic_field(goal_m))
        # Fronts on cells of 5 cm are short by some per cent.
        assert way_m >= 0.95 * math.dist(start_m, goal_m), episode.id


def test_a_goal_that_the_map_parts_from_its_start_is_refused(generated, monkeypatch):
    """With a map on which nothing is free no candidate is left, and the message says why."""
    source, _ = generated("HabNavigate-v1", "apartment")

    def nothing(map_, points_m):
        return np.zeros(len(points_m), dtype=bool)

    monkeypatch.setattr(NavigationMap, "is_free", nothing)
    monkeypatch.setattr(base, "ATTEMPTS", 3)
    monkeypatch.setattr(base, "LAYOUTS", 1)
    with pytest.raises(GenerationError, match="no way from the start to the goal"):
        source.make(0)


# Furnished layouts -----------------------------------------------------------------------------


@every_dataset
@pytest.mark.parametrize("env_id", ["HabPick-v1"])
def test_a_furnished_layouts_loose_objects_start_settled(generated, dataset, env_id):
    """In a simulation of its own: they are where they settle, and stay there beside the others."""
    source, (episode, *_) = generated(env_id, dataset, scene="apt_0")
    replay = Replay(source, episode)
    assert len(episode.loose) >= 90
    assert episode.loose.keys() == {o.name for o in replay.sandbox.spec.objects if o.dynamic}
    settled = replay.sandbox.settled
    assert all(math.dist(settled[n][:3], p[:3]) < 1e-4 for n, p in episode.loose.items())
    everything = {**episode.loose, **episode.objects}
    replay.stand()
    replay.sandbox.settle(2.0, tuple(everything))
    moved = {n: math.dist(replay.sandbox.pose(n)[:3], p[:3]) for n, p in everything.items()}
    assert not {name: way for name, way in moved.items() if way > 0.01}


# What is kept for evaluation -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("env_id", "check"), [("HabPick-v1", check_pick), ("HabPlace-v1", check_place)]
)
def test_novel_receptacles_are_those_kept_for_evaluation(generated, env_id, check):
    source, episodes = generated(env_id, "apartment", "receptacles")
    for episode in episodes:
        replay = Replay(source, episode)
        names = {sc.TABLE_DARK, sc.CHAIR, *sc.SHELVES}
        check(replay, episode.robot.base, names)
        assert {handle.rsplit("_:", 1)[0] for handle in episode.objects} <= sc.SEEN


@every_skill
def test_novel_objects_are_those_kept_for_evaluation(generated, env_id):
    _, episodes = generated(env_id, "apartment", "objects")
    names = {handle.rsplit("_:", 1)[0] for e in episodes for handle in e.objects}
    assert names
    assert names <= sc.UNSEEN
