"""All endings of the skills other than Pick, in the simulator."""

import math

import numpy as np
import pytest
from builders import first_episode, reach
from playing import ee_grip, held, joints, move_base, move_joint, put, still

from hab_tasks.robots.control_modes import BASE_CELLS, STOP_CELL

FRIDGES = ("HabOpenFridge-v1", "HabCloseFridge-v1")


def start(make, env_id, index=0, **options):
    env = make(env_id, **options)
    env.reset(options={"episode": index})
    return env


def ended(step):
    """Whether a step ended its episode, and its terms as numbers."""
    _, _, terminated, truncated, info = step
    assert not truncated
    return bool(terminated), {n: float(t) for n, t in info["reward_terms"].items()}


# Place -----------------------------------------------------------------------------------------


def goal_at(env, offset_m):
    """Makes the place `offset_m` away from the held object its goal."""
    base = env.unwrapped
    state = base.get_state_dict()
    goals = state["hab"]["goals"]
    com = base.privileged()[0].object_com_m[held(env)]
    goals["goals_m"][0, 0] = goals["goals_m"].new_tensor(np.add(com, offset_m))
    base.set_state_dict(state)


def test_place_succeeds_when_the_object_is_let_go_at_its_goal(make):
    env = start(make, "HabPlace-v1")
    goal_at(env, (0.1, 0.0, 0.0))
    over, terms = ended(env.step(ee_grip(env)))
    assert not over
    assert terms["place"] == terms["success"] == 0.0
    step = env.step(ee_grip(env, -1.0))
    over, terms = ended(step)
    # Within 0.15 m of the goal, the hand within 0.09 m of its resting position, as it started.
    assert over
    assert step[-1]["success"]
    assert (terms["success"], terms["place"]) == (20.0, 5.0)
    assert held(env) is None


@pytest.mark.parametrize(("distance_m", "placed"), [(0.13, True), (0.18, False)])
def test_placed_is_within_15_cm(make, distance_m, placed):
    env = start(make, "HabPlace-v1")
    goal_at(env, (0.0, distance_m, 0.0))
    info = env.step(ee_grip(env, -1.0))[-1]
    assert bool(info["measures"]["placed"]) == placed
    assert bool(info["success"]) == placed
    assert not info["fail"]


def test_place_grasps_nothing_once_the_object_is_placed(make):
    env = start(make, "HabPlace-v1")
    for _ in range(12):  # up, away from rest, so that letting go does not end the episode
        env.step(np.array([0, 0, 1, 1], dtype=np.float32))
    goal_at(env, (0.0, 0.0, -0.05))
    over, terms = ended(env.step(ee_grip(env, -1.0)))
    assert not over
    assert terms["place"] == 5.0
    for _ in range(3):
        over, terms = ended(env.step(ee_grip(env, 1.0)))
        assert held(env) is None
        assert terms["place"] == 0.0


def test_place_may_let_go_elsewhere_and_take_up_again(make):
    env = start(make, "HabPlace-v1")
    (target,) = env.unwrapped.episode[0].targets
    goal_at(env, (0.0, 2.0, 0.0))
    assert not ended(env.step(ee_grip(env, -1.0)))[0]
    assert held(env) is None
    put(env, target.object, (0.0, 0.0, -0.1))
    assert not ended(env.step(ee_grip(env)))[0]
    assert held(env) == target.object


def test_place_pays_for_the_wrong_object_and_goes_on(make):
    env = start(
        make, "HabPlace-v1", first_episode(make("HabPlace-v1"), lambda e: len(e.objects) > 1)
    )
    goal_at(env, (0.0, 2.0, 0.0))
    (target,) = env.unwrapped.episode[0].targets
    env.step(ee_grip(env, -1.0))
    other = next(n for n in sorted(env.unwrapped.episode[0].objects) if n != target.object)
    put(env, target.object, (0.0, 0.0, 0.6))
    put(env, other, (0.0, 0.0, -0.1))
    over, terms = ended(env.step(ee_grip(env)))
    assert held(env) == other
    assert not over
    assert terms["wrong_object"] == -5.0
    assert ended(env.step(ee_grip(env)))[1]["wrong_object"] == 0.0


def test_place_fails_by_force(make):
    known = make("HabPlace-v1")
    index = first_episode(known, lambda e: _goal_on(e, "Tbl", "Sofa", "counter"))
    env = start(make, "HabPlace-v1", index)
    goal = np.asarray(env.unwrapped._simulation.goals.goals_m)[0, 0]
    env.step(ee_grip(env, -1.0))  # forces on what is held do not count
    results = reach(env, goal - [0, 0, 0.6], -1.0, steps=199, within_m=0.0)
    info = results[-1][-1]
    assert info["failures"]["force"], float(info["measures"]["force_total_n"])
    over, terms = ended(results[-1])
    assert over
    assert terms["force_exceeded"] == -10.0
    assert float(info["measures"]["force_total_n"]) > 7500.0
    before = float(results[-2][-1]["measures"]["force_total_n"])
    assert before <= 7500.0


def _goal_on(episode, *words):
    goal = episode.targets[0].goal
    return goal is not None and any(word in goal[0] for word in words)


# Fridge ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("env_id", FRIDGES)
def test_leaving_the_region_before_the_fridge_ends_the_episode(make, env_id):
    """0.933 to 1.833 m before the fridge, 0.6 m to either side."""
    env = start(make, env_id)
    base = env.unwrapped
    fridge = base._simulation._grasp.handles[int(base._simulation.tracker.handles[0, 0])].furniture
    world_from_fridge = fridge.pose.to_transformation_matrix()[0].numpy()
    ahead = world_from_fridge[:2, 0] / np.linalg.norm(world_from_fridge[:2, 0])
    left = np.array([-ahead[1], ahead[0]])
    back = still(env)
    back[-2] = -1.0
    for _ in range(60):
        over, terms = ended(step := env.step(back))
        offset = np.asarray(base._simulation.snapshot.base)[0, :2] - world_from_fridge[:2, 3]
        x, y = offset @ ahead, offset @ left
        inside = 0.933 <= x <= 1.833 and -0.6 <= y <= 0.6
        assert over == (not inside), (x, y)
        if over:
            break
    assert step[-1]["failures"]["left_region"]
    assert terms.get("left_region") == (-10.0 if env_id == "HabOpenFridge-v1" else None)


@pytest.mark.parametrize(
    ("env_id", "just", "not_yet"),
    [
        # Open beyond 90 degrees; closed within 0.15 rad.
        ("HabOpenFridge-v1", math.pi / 2 + 0.01, math.pi / 2 - 0.01),
        ("HabCloseFridge-v1", 0.14, 0.16),
        # Closed within 5 cm.
        ("HabCloseDrawer-v1", 0.049, 0.051),
    ],
)
def test_a_front_is_done_where_the_skill_says(make, env_id, just, not_yet):
    env = start(make, env_id)
    base = env.unwrapped
    state = base.get_state_dict()
    for position, done in ((not_yet, False), (just, True)):
        move_joint(state, env, 0, position)
        base.set_state_dict(state)
        step = env.step(still(env))
        assert float(base._simulation.snapshot.joints[0, 0]) == pytest.approx(position, abs=2e-3)
        over, terms = ended(step)
        assert bool(step[-1]["success"]) == over == done
        assert terms["success"] == 10.0 * done


def test_a_drawer_is_open_at_nine_tenths_of_its_travel(make):
    """As it may push the robot, which stands before it, only the judgement is looked at."""
    env = start(make, "HabOpenDrawer-v1")
    base = env.unwrapped
    state = base.get_state_dict()
    goals = base._simulation.goals
    lower, upper = float(goals.joint_lower[0, 0]), float(goals.joint_upper[0, 0])
    for share, done in ((0.89, False), (0.91, True)):
        move_joint(state, env, 0, lower + share * (upper - lower))
        measures = state["hab"]["tracker"]
        measures["joint_share"][0] = share
        base.set_state_dict(state)
        assert bool(base.evaluate()["success"]) == done


@pytest.mark.parametrize("env_id", [*FRIDGES, "HabCloseDrawer-v1"])
def test_the_hand_has_to_be_at_rest(make, env_id):
    env = start(make, env_id)
    base = env.unwrapped
    for _ in range(15):
        lift = still(env)
        lift[2] = 1.0
        env.step(lift)
    assert float(base.measures.ee_to_rest_m[0]) > 0.15
    state = base.get_state_dict()
    move_joint(state, env, 0, 1.7 if env_id == "HabOpenFridge-v1" else 0.01)
    base.set_state_dict(state)
    step = env.step(still(env))
    assert not step[-1]["success"]
    assert not ended(step)[0]


@pytest.mark.parametrize("env_id", ["HabOpenFridge-v1", "HabOpenDrawer-v1", "HabCloseDrawer-v1"])
def test_only_handles_are_taken(make, env_id):
    env = start(make, env_id)
    (target,) = env.unwrapped.episode[0].targets
    put(env, target.object, (0.0, 0.0, -0.1))
    env.step(ee_grip(env))
    assert held(env) is None


# Navigate --------------------------------------------------------------------------------------


def navigate_at(make, offset_m, turn_rad, **options):
    """A start of Navigate with the robot beside its goal."""
    env = start(make, "HabNavigate-v1", **options)
    base = env.unwrapped
    x, y, yaw = base.episode[0].navigation.base
    state = base.get_state_dict()
    # Away from what the goal looks at, where the floor is free.
    move_base(
        state, env, x - offset_m * math.cos(yaw), y - offset_m * math.sin(yaw), yaw + turn_rad
    )
    base.set_state_dict(state)
    return env


def test_stopping_ends_navigate_within_30_cm_and_half_a_radian(make):
    for offset_m, turn_rad, there in (
        (0.0, 0.0, True),
        (0.2, 0.4, True),
        (0.2, 0.55, False),
        (0.45, 0.0, False),
    ):
        env = navigate_at(make, offset_m, turn_rad)
        step = env.step(STOP_CELL)
        over, terms = ended(step)
        measures = step[-1]["measures"]
        assert measures["stopped"]
        assert float(measures["base_to_goal_m"]) == pytest.approx(offset_m, abs=0.06)
        assert float(measures["heading_error_rad"]) == pytest.approx(turn_rad, abs=1e-3)
        assert bool(step[-1]["success"]) == over == there, (offset_m, turn_rad)
        assert terms["success"] == 10.0 * there


def test_arriving_without_the_stop_action_ends_nothing(make):
    env = navigate_at(make, 0.0, 0.0)
    for cell in (BASE_CELLS.index((0.0, 0.5)), BASE_CELLS.index((0.0, -0.5))):
        step = env.step(cell)
        assert not ended(step)[0]
        assert float(step[-1]["measures"]["base_to_goal_m"]) < 0.3
    assert ended(env.step(STOP_CELL))[0]


def test_arriving_is_enough_where_the_stop_is_not_learned(make):
    env = navigate_at(make, 0.0, 0.0, skill_config={"learned_stop": 0})
    over, terms = ended(env.step(BASE_CELLS.index((0.0, 0.5))))
    assert over
    assert terms["success"] == 10.0


def test_navigate_holds_what_it_starts_with(make):
    known = make("HabNavigate-v1")
    index = first_episode(known, lambda e: e.held is not None)
    env = start(make, "HabNavigate-v1", index, obs_mode="state_dict")
    name = held(env)
    assert name is not None
    for cell in (BASE_CELLS.index((0.0, 1.0)), BASE_CELLS.index((0.5, 0.0))) * 5:
        obs, *_ = env.step(cell)
        assert held(env) == name
        assert float(obs["agent"]["is_holding"]) == 1.0


def test_doors_stay_where_they_are_while_one_drives(make):
    env = start(make, "HabNavigate-v1")
    before = joints(env)
    for _ in range(10):
        env.step(BASE_CELLS.index((0.0, 1.0)))
    assert all(np.allclose(value, before[name], atol=1e-3) for name, value in joints(env).items())
