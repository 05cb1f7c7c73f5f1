"""Start states of the three tasks (S G.1), checked in an independent simulation."""

import math

import numpy as np
import pytest
import start_checks as sc
import torch
from start_checks import TASKS, Replay

real_slow = [pytest.mark.assets, pytest.mark.slow]
every_task = pytest.mark.parametrize(
    ("env_id", "dataset"),
    [
        ("HabSetTable-v1", "apartment"),
        *(pytest.param(t, "apartment", marks=pytest.mark.slow) for t in TASKS[:2]),
        pytest.param(TASKS[2], "real", marks=real_slow),
        *(pytest.param(t, "real", marks=[pytest.mark.assets, pytest.mark.long]) for t in TASKS[:2]),
    ],
)
tidy_house, prepare_groceries, set_table = (
    pytest.mark.parametrize(
        ("env_id", "dataset"), [(task, "apartment"), pytest.param(task, "real", marks=real_slow)]
    )
    for task in TASKS
)


@pytest.fixture
def replays(generated, dataset, env_id):
    """The env's episodes, each in its layout again."""
    source, episodes = generated(env_id, dataset)
    return (Replay(source, episode) for episode in episodes)


@every_task
def test_objects_rest_apart_on_their_receptacles_and_the_robot_stands_free(replays, env_id):
    clutter = 25 if env_id == TASKS[0] else 27
    for replay in replays:
        episode, goals = replay.episode, replay.at_goals()
        others = episode.objects.keys() - {t.object for t in episode.targets}
        # A fifth of it may find no room.
        assert 0.8 * clutter <= len(others) <= clutter, episode.id
        assert {handle.rsplit("_:", 1)[0] for handle in others} <= sc.SEEN
        assert episode.held is episode.handle is episode.navigation is None
        assert replay.moved_m(replay.resting()) < 0.01, episode.id
        assert replay.joints_moved() < 0.01, episode.id
        assert replay.moved_m(goals, [target.object for target in episode.targets]) < 0.01
        for poses in (episode.objects, goals):
            assert not replay.overlaps(poses), episode.id
            replay.stand(poses)
            for name in (sc.CHAIR, sc.SINK):
                assert all(count <= 2 for count in replay.count_on(name).values()), name
        for target in episode.targets:
            check_target(replay, target)
        replay.stand()
        assert not replay.touches(), episode.id
        assert replay.off_floor_m(episode.robot.base) < 1e-5, episode.id


def check_target(replay, target):
    """It goes half a metre at least, from one receptacle to another."""
    start = replay.episode.objects[target.object]
    assert math.dist(start[:3], target.world_from_goal[:3]) >= 0.5, replay.episode.id
    replay.stand()
    assert replay.stands_on(target.object, target.start), target
    replay.stand(replay.at_goals())
    # An apple in a bowl is not down on the table.
    beside, height = replay.over(replay.sandbox.com_m(target.object), target.goal)
    assert beside < 0.02, target
    assert -0.02 < height < 0.3, target


@pytest.mark.parametrize("env_id", [TASKS[0], pytest.param(TASKS[1], marks=pytest.mark.slow)])
def test_novel_objects_are_those_kept_for_evaluation(generated, env_id):
    _, episodes = generated(env_id, "apartment", "objects")
    assert {handle.rsplit("_:", 1)[0] for e in episodes for handle in e.objects} <= sc.UNSEEN


@tidy_house
def test_tidy_house_moves_five_of_thirty_between_open_receptacles(replays):
    for replay in replays:
        episode = replay.episode
        assert len({t.object for t in episode.targets}) == 5
        assert len(episode.objects) <= 30
        assert {ref[0] for t in episode.targets for ref in (t.start, t.goal)} <= sc.EIGHT
        assert episode.joints == {}


@prepare_groceries
def test_prepare_groceries_empties_and_fills_an_open_fridge(replays):
    for replay in replays:
        episode = replay.episode
        first, second, third = episode.targets
        assert first.start[0] == second.start[0] == third.goal[0] == sc.FRIDGE
        assert first.goal[0] in sc.COUNTERS
        assert second.goal[0] == sc.TABLE_LIGHT
        assert third.start[0] in sc.COUNTERS
        (fridge,) = {ref[1].partition("/")[0] for ref in (first.start, second.start, third.goal)}
        (counter,) = episode.joints.keys() - {fridge}
        assert episode.joints[fridge].keys() == {"top_door_hinge"}
        assert episode.joints[fridge]["top_door_hinge"] > math.pi / 2  # open (S H.2)
        assert episode.joints[counter].keys() == {"right_slide_top"}
        travel = replay.sandbox.joint_limits(counter, "right_slide_top")[1]
        assert episode.joints[counter]["right_slide_top"] >= 0.9 * travel


@set_table
def test_set_table_puts_an_apple_into_a_bowl_both_from_behind_closed_fronts(replays):
    for replay in replays:
        episode = replay.episode
        bowl, apple = episode.targets
        assert bowl.object.startswith("024_bowl_:")
        assert apple.object.startswith("013_apple_:")
        assert (bowl.start[0], apple.start[0]) == (sc.DRAWER, sc.FRIDGE)
        assert bowl.goal == apple.goal
        assert bowl.goal[0] == sc.TABLE_LIGHT
        assert episode.joints == {}
        replay.stand()
        beside, _ = replay.over(replay.sandbox.com_m(bowl.object), bowl.start)
        assert beside < 0.0, "the bowl sticks out of the drawer"
        replay.stand(replay.at_goals())
        way = replay.sandbox.com_m(apple.object) - replay.sandbox.com_m(bowl.object)
        # A bowl is 16 cm wide and 5 cm high; an apple of 7 cm lies in it, sticking out at the top.
        assert np.linalg.norm(way[:2]) < 0.05, episode.id
        bodies = [replay.sandbox._components[t.object][1] for t in (apple, bowl)]
        (low, _), (floor, brim) = (body.compute_global_aabb_tight()[:, 2] for body in bodies)
        assert floor < low < brim - 0.02, episode.id


@set_table
def test_the_bowl_comes_out_with_the_drawer(replays):
    """Pulled by physics at 0.2 m/s for 1.5 s, which is 0.3 m."""
    for replay in replays:
        sandbox, bowl = replay.sandbox, replay.episode.targets[0]
        replay.stand()
        furniture, _, link = bowl.start[1].partition("/")
        drawer = sandbox.scene_bodies.articulations[furniture]
        index = [j.child_link.name for j in drawer.active_joints].index(link)
        start = sandbox.com_m(bowl.object)
        before = np.linalg.inv(sandbox.world_from(bowl.start[1])) @ (*start, 1.0)
        speed = torch.zeros_like(drawer.get_qvel())
        speed[0, index] = 0.2
        for _ in range(180):
            drawer.set_qvel(speed)
            sandbox._px.step()
        assert float(drawer.get_qpos()[0, index]) == pytest.approx(0.3, abs=0.02)
        end = sandbox.com_m(bowl.object)
        after = np.linalg.inv(sandbox.world_from(bowl.start[1])) @ (*end, 1.0)
        assert np.linalg.norm(after - before) < 0.06, "it slides about in the drawer"
        assert math.dist(start, end) > 0.24
