"""Stages, ends of skills, failure categories and options, without a simulation."""

from dataclasses import replace
from types import SimpleNamespace

import hab_tp_srl
import numpy as np
import pytest
from hab_planner.plan import plan_of
from hab_planner.problem import task_of
from hab_ppo import checkpoint
from hab_ppo.recipes import find_recipe
from hab_spa.motion.robot import GRASP, RELEASE
from hab_tp_srl.ending import Ending
from hab_tp_srl.executor import fault
from hab_tp_srl.factories import skills_of
from hab_tp_srl.options import SKILLS
from hab_tp_srl.stage import stage_of
from hab_tp_srl.training_starts import features, start_ranges
from hab_tp_srl.view import TaskView
from untrained import write_weights

from hab_tasks.agent_spaces import agent_setup
from hab_tasks.constants import REST_POSITION_M
from hab_tasks.episodes import EpisodeRequest, load_episodes
from hab_tasks.errors import HabError
from hab_tasks.registration import TASKS

TASK_IDS = ("HabTidyHouse-v1", "HabPrepareGroceries-v1", "HabSetTable-v1", "my_tasks:ClearTable-v1")


def test_stages_are_the_parts_that_the_reward_of_a_task_follows():
    for task_id in TASK_IDS:
        task = task_of(task_id)
        stages = [stage_of(task, a) for a in plan_of(task_id).actions if a.name != "navigate"]
        parts = [part for part in task.parts if part.skill.name != "navigate"]
        assert [stage.skill for stage in stages] == [part.skill.name for part in parts]
        assert [stage.object for stage in stages] == [part.object for part in parts]
        for stage, part in zip(stages, parts, strict=True):
            assert stage.articulation in (None, part.articulation)
        used = {stage.skill for stage in stages}
        assert used <= set(skills_of(task.spec.id, task)) <= set(SKILLS)


def test_a_door_is_opened_for_what_starts_behind_it_or_goes_there():
    def of(task_id, name):
        task = task_of(task_id)
        actions = [a for a in plan_of(task_id).actions if a.skill == name]
        return stage_of(task, actions[0])

    bowl = of("HabSetTable-v1", "close_drawer")
    assert (bowl.object, bowl.at, bowl.drawer) == (0, "start", 0)
    apple = of("HabSetTable-v1", "open_fridge")
    assert (apple.object, apple.at, apple.drawer) == (1, "start", None)
    assert of("HabSetTable-v1", "pick").drawer == 0
    assert of("HabSetTable-v1", "place").drawer is None
    fruit = of("my_tasks:ClearTable-v1", "open_fridge")
    assert (fruit.object, fruit.at) == (0, "goal")
    assert set(TASKS) >= {"ClearTable-v1"}


def ending(skill, moved_m=None):
    view = SimpleNamespace(holding=False, rests=True, moved_m=lambda number: moved_m)
    handles_object = skill in ("pick", "place")
    articulation = None if handles_object else 0
    stage = SimpleNamespace(skill=skill, handles_object=handles_object, articulation=articulation)
    return view, Ending(None, stage, view, None)


def ends_after(skill, states):
    """The number of steps, each (holding, at rest), after which a skill ends; None if never."""
    view, watched = ending(skill)
    for number, (view.holding, view.rests) in enumerate(states, 1):
        watched.update()
        if watched.over:
            return number
    return None


REST, AWAY, HELD_AWAY, HELD = (False, True), (False, False), (True, False), (True, True)


def test_a_skill_ends_by_what_the_robot_feels():
    cases = (
        ("pick", [REST, AWAY, HELD_AWAY, HELD], 4),
        ("pick", [AWAY, REST], None),
        ("place", [HELD, HELD_AWAY, AWAY, REST], 4),
        ("open_drawer", [REST, AWAY, HELD_AWAY, AWAY, REST], 5),
        ("open_drawer", [REST, AWAY, REST], None),
        ("open_fridge", [HELD, HELD], None),
        ("close_fridge", [REST, AWAY, REST], 3),
        ("close_drawer", [REST, REST], None),
    )
    assert [case for case in cases if ends_after(*case[:2]) != case[2]] == []


def test_a_door_that_was_opened_is_closed_when_its_handle_is_back():
    view, watched = ending("close_fridge", moved_m=1.1)
    for view.rests, moved_m, over in (
        (True, 1.1, False),
        (False, 0.3, False),
        (True, 0.16, False),  # at rest, but the door is still 0.25 rad open
        (True, 0.04, True),
    ):
        view.moved_m = lambda number, moved_m=moved_m: moved_m
        watched.update()
        assert watched.over == over
    # A door that is still where it was at the start of the episode was open then.
    view, watched = ending("close_fridge", moved_m=0.0)
    view.rests = False
    watched.update()
    view.rests, view.moved_m = True, lambda number: 1.1
    watched.update()
    assert watched.over


def test_the_gripper_is_masked_as_in_the_environments_of_the_skills():
    view, watched = ending("pick")
    assert watched.gripper(-0.3) == RELEASE
    assert watched.gripper(0.3) == watched.gripper(0.0) == GRASP
    view.holding = True
    assert watched.gripper(-0.3) == GRASP
    assert watched.after() == GRASP
    view, watched = ending("place")
    view.holding = True
    watched.update()
    assert (watched.gripper(-1.0), watched.gripper(1.0)) == (RELEASE, GRASP)
    view.holding = False
    watched.update()
    assert watched.gripper(1.0) == RELEASE
    view, watched = ending("open_drawer")
    view.holding = True
    watched.update()
    assert (watched.gripper(-1.0), watched.after()) == (RELEASE, RELEASE)


def entry(stage, did, outcome="done", plan=0, attempt=0, **facts):
    return {
        "plan": plan, "stage": stage, "attempt": attempt, "did": did, "outcome": outcome, **facts
    }  # fmt: skip


def test_the_failure_is_the_first_stage_that_was_not_achieved():
    assert fault([]) is None
    good = [entry(1, "navigate"), entry(1, "pick", achieved=True)]
    assert fault(good) is None
    assert fault([*good, entry(2, "navigate"), entry(2, "place", achieved=False)]) == "place failed"
    late = [*good, entry(2, "navigate", "timeout"), entry(2, "place", "timeout", achieved=False)]
    assert fault(late) == "navigate timeout"
    again = [entry(2, "navigate", attempt=1), entry(2, "place", attempt=1, achieved=True)]
    assert fault([*late, *again]) is None
    assert fault([*late, entry(1, "pick", plan=1, achieved=True)]) is None
    assert fault([{"did": "rest"}, entry(1, "navigate", "target plan")]) == "navigate target plan"
    begun = {"start": "new", "achieved": False}
    assert fault([entry(1, "pick", "timeout", **begun)]) == "pick timeout, new start"
    assert fault([entry(1, "pick", **begun)]) == "pick failed, new start"
    assert fault([entry(1, "pick", **(begun | {"start": "known"}))]) == "pick failed"


def test_training_knows_the_starts_of_its_own_episodes_and_no_others():
    ranges = start_ranges("HabPick-v1")
    (episode,) = load_episodes(EpisodeRequest(env_id="HabPick-v1", split="val"), 1).episodes
    x, y, yaw = episode.robot.base
    far, side, height = (np.array(episode.objects[episode.target][:3]) - (x, y, 0.0)).tolist()
    ahead, left = np.array((np.cos(yaw), np.sin(yaw))), np.array((-np.sin(yaw), np.cos(yaw)))
    point_m = np.array(((far, side) @ ahead, (far, side) @ left, height))
    rest_m = np.array(REST_POSITION_M)
    assert ranges.include(features(point_m, rest_m))
    assert not ranges.include(features(point_m * (1.7, 1.7, 1.0), rest_m))  # 1.3 m away
    assert not ranges.include(features(point_m * (-1.0, 1.0, 1.0), rest_m))  # behind the robot
    assert not ranges.include(features(point_m, rest_m + np.eye(3)[1] * 0.2))  # off rest
    assert start_ranges("HabTidyHouse-v1") is None


BAD = [
    ({}, "No weights ship for pick_blind; train them with `hab-ppo train pick_blind` and give"),
    ({"skills": "depth"}, "No weights ship for pick_depth"),
    ({"skills": "dept"}, "Did you mean 'depth'?"),
    ({"pick": "pick_blnd"}, "Did you mean 'pick_blind'?"),
    ({"pik": "spa_priv"}, "Did you mean 'pick'?"),
    (
        {"skills": "spa_priv", "pick": "{place_blind}"},
        "was trained in HabPlace-v1; option pick needs pick",
    ),
    ({"pick": "/nowhere/best.safetensors"}, "value of the agent's option pick"),
    ({"navigation": "walk"}, "Valid: learned, oracle, teleport"),
    ({"navigate": "{navigate_blind}"}, "learned, with the option navigate"),
    ({"skills": "spa_priv", "retries": "-1"}, "option retries of the agent"),
    (
        {"skills": "spa_priv", "navigation": "learned", "navigate": "navigate_depth"},
        "No weights ship for navigate_depth",
    ),
    (
        {"skills": "spa_priv", "navigation": "learned", "navigate": "navigatr"},
        "Did you mean 'navigator'?",
    ),
]


def test_wrong_options_are_told_in_one_line(weights):
    wrong = []
    for options, message in BAD:
        given = {name: value.format(**weights) for name, value in options.items()}
        with pytest.raises(HabError) as caught:
            hab_tp_srl.tp_srl(agent_setup("HabTidyHouse-v1", options=given))
        told = str(caught.value)
        if message not in told or "\n" in told:
            wrong.append((options, told))
    assert not wrong


def test_a_skill_that_a_task_cannot_run_is_told(weights, learned, tmp_path):
    def fails(recipe, text):
        write_weights(recipe, tmp_path / "own.safetensors")
        options = {**learned, "pick": str(tmp_path / "own.safetensors")}
        with pytest.raises(HabError, match=text):
            hab_tp_srl.tp_srl(agent_setup("HabTidyHouse-v1", options=options))

    pick = find_recipe("pick_blind")
    fails(replace(pick, env=replace(pick.env, control_mode="joint_state")), "must drive the joints")
    fails(replace(pick, env=replace(pick.env, env="HabTidyHouse-v1", control_mode="ee_base")),
          "was trained in HabTidyHouse-v1")  # fmt: skip
    with pytest.raises(HabError, match="not a task"):
        hab_tp_srl.tp_srl(agent_setup("HabPick-v1"))
    with pytest.raises(HabError, match="needs to know where things are"):
        hab_tp_srl.tp_srl(agent_setup("HabTidyHouse-v1", options={**learned, "replan": "1"}))


def test_the_spec_says_what_a_team_needs(weights, learned):
    def spec(task="HabSetTable-v1", **options):
        return hab_tp_srl.tp_srl(agent_setup(task, options={**learned, **options})).spec

    assert not spec().privileged
    assert spec().handle_position
    assert spec().rows > 1
    assert not spec("HabTidyHouse-v1").handle_position
    assert spec(knowledge="true").privileged
    mixed = spec(place="spa_priv")
    assert (mixed.privileged, mixed.rows) == (True, 1)
    assert mixed.name == "TP+SRL (learned navigation; place by SPA-Priv)"
    assert spec(pick=str(weights["pick_depth"])).obs_mode == "depth"
    oracle = {name: value for name, value in learned.items() if name != "navigate"}
    given = {**oracle, "navigation": "teleport", "pick": str(weights["pick_depth"])}
    seen = hab_tp_srl.tp_srl(agent_setup("HabTidyHouse-v1", options=given)).spec
    assert (seen.looks, seen.control_mode) == ("on demand", "joint_target_pose")
    assert seen.rows > 1
    assert np.isfinite(checkpoint.load(weights["pick_depth"])[1]["format"])


def seen(base, starts, hand_m=(0.5, 0.0, 1.0), holding=False):
    """An observation without handles of a robot at `base`, and the world's places of one object."""
    x, y, yaw = base
    turn = np.array(((np.cos(yaw), -np.sin(yaw)), (np.sin(yaw), np.cos(yaw))))
    level = (starts[:, :2] - (x, y)) @ turn
    pairs = np.concatenate((level, starts[:, 2:]), axis=1)
    agent = {
        "ee_position": np.array([hand_m], dtype=np.float32),
        "ee_rotation": np.array([[1, 0, 0, 0, 1, 0]], dtype=np.float32),
        "is_holding": np.array([[float(holding)]], dtype=np.float32),
    }
    return {"agent": agent, "extra": {"targets_in_base": pairs.reshape(1, -1).astype(np.float32)}}


def test_without_handles_the_hand_that_pulls_shows_how_far_a_drawer_moved():
    starts = np.array([[2.0, 1.0, 0.6], [-1.5, 0.4, 0.8]])
    pull = SimpleNamespace(skill="open_drawer", articulation=0)
    pick = SimpleNamespace(skill="pick", at="start", object=0, drawer=0, articulation=None)
    view = TaskView(truth=False)
    view.see(seen((0.3, -0.2, 0.5), starts), 0)
    first = view.point(pick)
    base = (1.0, 0.9, np.pi / 2)
    view.see(seen(base, starts), 0)
    view.begin(pull)
    for step, holding in ((0.0, False), (0.0, True), (0.1, True), (0.4, True), (0.1, False)):
        view.see(seen(base, starts, (0.8 - step, 0.1, 0.6), holding), 0)
    moved = view.point(pick)
    assert np.linalg.norm(moved - first) == pytest.approx(0.4, abs=1e-5)
    view.begin(pick)
    # The robot faces +y and pulled the drawer by 0.4 m towards itself: to (2.0, 0.6).
    for x, y, yaw in (base, (1.6, -0.5, 2.0)):
        view.see(seen((x, y, yaw), starts, holding=True), 0)
        entries = view.entries(pick, moved)
        turn = np.array(((np.cos(yaw), -np.sin(yaw)), (np.sin(yaw), np.cos(yaw))))
        expected = (np.array((2.0, 0.6)) - (x, y)) @ turn
        np.testing.assert_allclose(entries["extra", "point_in_base"][:2], expected, atol=1e-5)
        from_hand = [*(expected - (0.5, 0.0)), 0.6 - 1.0]
        np.testing.assert_allclose(entries["extra", "object_start_from_ee"], from_hand, atol=1e-5)
    view.forget()
    view.see(seen(base, starts), 0)
    np.testing.assert_allclose(view.point(pick)[2], 0.6, atol=1e-6)


@pytest.mark.parametrize("aims_object", [False, True])
def test_place_aims_by_the_object_where_the_pick_grasped_it(aims_object):
    start, goal = np.array([2.0, 1.0, 0.8]), np.array([-1.5, 0.4, 0.9])
    pick = SimpleNamespace(skill="pick", at="start", object=0, drawer=None, articulation=None)
    place = SimpleNamespace(skill="place", at="goal", object=0, drawer=None, articulation=None)
    view = TaskView(truth=False, aims_object=aims_object)
    places = np.stack((start, goal))
    base = (1.2, 1.0, 0.0)  # it faces +x, so the object is at (0.8, 0, 0.8) of its frame
    view.see(seen(base, places), 0)
    view.begin(pick)
    view.see(seen(base, places, (0.75, 0.02, 0.88), holding=True), 0)  # (0.05, -0.02, -0.08) away
    view.see(seen(base, places, (0.5, 0.0, 1.0), holding=True), 0)
    view.begin(place)
    entries = view.entries(place, view.point(place))
    # The goal is at (-2.7, -0.6, 0.9) of the base frame, the hand at (0.5, 0, 1).
    from_hand = np.array([-3.2, -0.6, -0.1])
    offset = np.array([0.05, -0.02, -0.08]) * aims_object
    np.testing.assert_allclose(
        entries["extra", "object_goal_from_ee"], from_hand - offset, atol=1e-5
    )
    view.begin(pick)
    again = view.entries(pick, view.point(pick))
    np.testing.assert_allclose(again["extra", "object_start_from_ee"], (0.3, 0, -0.2), atol=1e-5)


def test_with_the_truth_a_wrong_object_ends_a_pick():
    view = SimpleNamespace(holding=True, rests=False)
    stage = SimpleNamespace(skill="pick", object=1, handles_object=True, articulation=None)
    for held, failed in ((0, True), (1, False), (None, False)):
        scene = SimpleNamespace(holding=held is not None, holds=lambda k, held=held: k == held)
        watched = Ending(None, stage, view, scene)
        watched.update()
        assert (watched.failed, watched.over) == (failed, False)
        assert watched.gripper(-1.0) == (GRASP if held == 1 else RELEASE)
    assert not Ending(None, stage, view, None).failed
