"""Stages, ends of skills, still arms, failures and options, without a simulation."""

from dataclasses import replace
from types import SimpleNamespace

import hab_tp_srl
import numpy as np
import pytest
from hab_plans.motion import GRASP, RELEASE
from hab_plans.plan import plan_of
from hab_plans.problem import task_of
from hab_plans.stage import stage_of
from hab_ppo.recipes import find_recipe
from hab_tp_srl.ending import Ending
from hab_tp_srl.factories import fault, skills_of
from hab_tp_srl.options import SKILLS
from hab_tp_srl.policies import Stillness
from hab_tp_srl.view import TaskView
from refusals import check_each, refused_by_call
from untrained import write_weights

from hab_tasks.agent_spaces import agent_setup

TASK_IDS = ("HabTidyHouse-v1", "HabPrepareGroceries-v1", "HabSetTable-v1", "my_tasks:ClearTable-v1")


def test_stages_are_the_parts_that_the_reward_of_a_task_follows():
    for task_id in TASK_IDS:
        task = task_of(task_id)
        stages = [stage_of(task, action) for action in plan_of(task_id).interactions]
        parts = [part for part in task.parts if part.skill.name != "navigate"]
        assert [stage.skill for stage in stages] == [part.skill.name for part in parts]
        assert [stage.object for stage in stages] == [part.object for part in parts]
        for stage, part in zip(stages, parts, strict=True):
            assert stage.articulation in (None, part.articulation)
        used = {stage.skill for stage in stages}
        assert used <= set(skills_of(task.spec.id, task)) <= set(SKILLS)


def ending(skill, moved_m=None):
    view = SimpleNamespace(holding=False, rests=True, moved_m=lambda number: moved_m)
    carries = skill in ("pick", "place")
    articulation = None if carries else 0
    stage = SimpleNamespace(skill=skill, handles_object=carries, articulation=articulation)
    return view, Ending(None, stage, view, None)


REST, AWAY, HELD_AWAY, HELD = (False, True), (False, False), (True, False), (True, True)


# States (holding, at rest), and the number of steps after which a skill ends; None if never.
@pytest.mark.parametrize(
    ("skill", "states", "steps"),
    [
        ("pick", [REST, AWAY, HELD_AWAY, HELD], 4),
        ("pick", [AWAY, REST], None),
        ("place", [HELD, HELD_AWAY, AWAY, REST], 4),
        ("open_drawer", [REST, AWAY, HELD_AWAY, AWAY, REST], 5),
        ("open_fridge", [HELD, HELD], None),
        ("close_fridge", [REST, AWAY, REST], 3),
        ("close_drawer", [REST, REST], None),
    ],
)
def test_a_skill_ends_by_what_the_robot_feels(skill, states, steps):
    view, watched = ending(skill)
    over = []
    for view.holding, view.rests in states:
        watched.update()
        over.append(watched.over)
    assert (over.index(True) + 1 if any(over) else None) == steps


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


def test_the_gripper_is_masked_as_in_the_environments_of_the_skills():
    view, watched = ending("pick")
    assert watched.gripper(-0.3) == RELEASE
    assert watched.gripper(0.3) == watched.gripper(0.0) == GRASP
    view.holding = True
    assert watched.gripper(-0.3) == watched.after() == GRASP
    view, watched = ending("place")
    for view.holding, gripper in ((True, GRASP), (False, RELEASE)):
        watched.update()
        assert watched.gripper(1.0) == gripper
    view, watched = ending("open_drawer")
    view.holding = True
    watched.update()
    assert watched.gripper(-1.0) == watched.after() == RELEASE


def test_with_the_truth_a_wrong_object_ends_a_pick():
    view = SimpleNamespace(holding=True, rests=False)
    stage = SimpleNamespace(skill="pick", object=1, handles_object=True, articulation=None)
    for held, failed in ((0, True), (1, False)):
        scene = SimpleNamespace(holding=True, holds=lambda k, held=held: k == held)
        watched = Ending(None, stage, view, scene)
        watched.update()
        assert (watched.failed, watched.over) == (failed, False)
        assert watched.gripper(-1.0) == (RELEASE if failed else GRASP)


def test_after_twenty_still_steps_twenty_actions_are_drawn():
    for motions_rad, expected in (
        # Step 0 has no step before it. Steps 1 to 20 are still, so that steps 20 to 39 are drawn.
        # Of steps 40 to 59 none moves either: step 59 is the twentieth.
        ([0.0] * 59, [*range(20, 40), 59]),
        ([0.005] * 100, []),
        ([*[0.0] * 19, -0.005] * 5, []),
        ([0.003] * 21, [20, 21]),  # it creeps
        ([*[0.0] * 20, *[0.05] * 40], [*range(20, 40)]),
    ):
        stillness, arm_rad = Stillness(), np.linspace(-1.0, 1.0, 7)
        drawn = []
        for motion_rad in (0.0, *motions_rad):
            arm_rad[3] += motion_rad
            drawn.append(stillness.draws(arm_rad))
        assert np.flatnonzero(drawn).tolist() == expected


def entry(stage, did, outcome="done", plan=0, attempt=0, **facts):
    about = {"plan": plan, "stage": stage, "attempt": attempt}
    return {**about, "did": did, "outcome": outcome, **facts}


def test_the_failure_is_the_first_stage_that_was_not_achieved():
    good = [entry(1, "navigate"), entry(1, "pick", achieved=True)]
    late = [*good, entry(2, "navigate", "timeout"), entry(2, "place", "timeout", achieved=False)]
    for trace, failure in (
        (good, None),
        ([*good, entry(2, "navigate"), entry(2, "place", achieved=False)], "place failed"),
        (late, "navigate timeout"),
        ([*late, entry(2, "place", attempt=1, achieved=True)], None),
        ([*late, entry(1, "pick", plan=1, achieved=True)], None),
        ([{"did": "rest"}, entry(1, "navigate", "target plan")], "navigate target plan"),
        ([entry(1, "pick", "timeout", start="new", achieved=False)], "pick timeout, new start"),
        ([entry(1, "pick", start="known", achieved=False)], "pick failed"),
    ):
        assert fault(trace) == failure


def team(task="HabTidyHouse-v1", **options):
    return hab_tp_srl.tp_srl(agent_setup(task, options=options))


def test_wrong_options_are_told_in_one_line(weights):
    planned = {"skills": "spa_priv"}
    cases = (
        ({}, "No weights ship for pick_blind; train them with `hab-ppo train pick_blind` and give"),
        ({"skills": "dept"}, "Did you mean 'depth'?"),
        ({"pik": "spa_priv"}, "Did you mean 'pick'?"),
        (planned | {"pick": str(weights["place_blind"])}, "was trained in HabPlace-v1; option"),
        ({"pick": "/nowhere/best.safetensors"}, "value of the agent's option pick"),
        ({"navigation": "walk"}, "Valid: learned, oracle, perfect"),
        ({"navigate": str(weights["navigate_blind"])}, "learned, with the option navigate"),
        (planned | {"retries": "-1"}, "option retries of the agent"),
    )
    check_each(
        {str(case): case for case in cases},
        lambda case: refused_by_call(lambda: team(**case[0]), case[1]),
    )


def test_a_skill_that_a_task_cannot_run_is_told(learned, tmp_path):
    path, pick = tmp_path / "own.safetensors", find_recipe("pick_blind")
    for changes, message in (
        ({"control_mode": "joint_state"}, "must drive the joints"),
        ({"env": "HabTidyHouse-v1", "control_mode": "ee_base"}, "was trained in HabTidyHouse-v1"),
    ):
        write_weights(replace(pick, env=replace(pick.env, **changes)), path)
        refused_by_call(lambda: team(**{**learned, "pick": str(path)}), message)
    refused_by_call(lambda: team("HabPick-v1"), "not a task")


def test_the_spec_says_what_a_team_needs(weights, learned):
    spec = team("HabSetTable-v1", **learned).spec
    assert (spec.privileged, spec.handle_position, spec.obs_mode) == (False, True, "state_dict")
    blind = dict.fromkeys(("skills", "navigation"), "blind") | learned
    assert not hab_tp_srl.from_sensors(agent_setup("HabSetTable-v1", options=blind)).spec.privileged
    planned = hab_tp_srl.spa_from_sensors(agent_setup("HabSetTable-v1")).spec
    assert (planned.privileged, planned.handle_position, planned.obs_mode) == (
        False,
        False,
        "depth",
    )
    mixed = team(**{**learned, "place": "spa_priv", "pick": str(weights["pick_depth"])}).spec
    assert (mixed.privileged, mixed.rows, mixed.handle_position) == (True, 1, False)
    assert (mixed.obs_mode, mixed.looks) == ("depth", "on demand")


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
    pull = SimpleNamespace(skill="open_drawer", articulation=0, drawer=None)
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
    pick = SimpleNamespace(skill="pick", at="start", object=0, drawer=None, articulation=None)
    place = SimpleNamespace(skill="place", at="goal", object=0, drawer=None, articulation=None)
    view = TaskView(truth=False, aims_object=aims_object)
    places = np.array([[2.0, 1.0, 0.8], [-1.5, 0.4, 0.9]])  # of the object and of its goal
    base = (1.2, 1.0, 0.0)  # it faces +x, so the object is at (0.8, 0, 0.8) of its frame
    view.see(seen(base, places), 0)
    view.begin(pick)
    view.see(seen(base, places, (0.75, 0.02, 0.88), holding=True), 0)  # (0.05, -0.02, -0.08) away
    view.see(seen(base, places, (0.5, 0.0, 1.0), holding=True), 0)
    view.begin(place)
    aim = view.entries(place, view.point(place))["extra", "object_goal_from_ee"]
    # The goal is at (-2.7, -0.6, 0.9) of the base frame, the hand at (0.5, 0, 1).
    offset = np.array([0.05, -0.02, -0.08]) * aims_object
    np.testing.assert_allclose(aim, np.array([-3.2, -0.6, -0.1]) - offset, atol=1e-5)
