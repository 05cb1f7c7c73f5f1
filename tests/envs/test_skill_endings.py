"""All endings of the skills other than Pick, in the simulator."""

import math

import numpy as np
import pytest
from builders import first_episode, same
from playing import ee_grip, held, joints, move_base, move_joint, play, put, still

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


def goal_at(env, offset_m):
    """Makes the place `offset_m` away from the held object its goal."""
    base = env.unwrapped
    state = base.get_state_dict()
    goals = state["hab"]["goals"]
    com = base.privileged()[0].object_com_m[held(env)]
    goals["goals_m"][0, :3] = goals["goals_m"].new_tensor(np.add(com, offset_m))
    base.set_state_dict(state)


def test_place_succeeds_when_the_object_rests_at_its_goal(make):
    env = start(make, "HabPlace-v1")
    name = held(env)
    before_m = env.unwrapped.privileged()[0].object_com_m[name]
    for _ in range(60):
        env.step(ee_grip(env, -1.0))
    fall_m = np.subtract(env.unwrapped.privileged()[0].object_com_m[name], before_m)
    for beside_m, wins in ((0.1, True), (0.18, False)):
        env = start(make, "HabPlace-v1")
        goal_at(env, np.add(fall_m, (0.0, beside_m, 0.0)))
        assert not ended(env.step(ee_grip(env)))[0]
        paid = []
        for _ in range(60):
            step = env.step(ee_grip(env, -1.0))
            over, terms = ended(step)
            paid.append((terms["place"], terms["success"]))
            assert over == bool(step[-1]["success"]) == bool(step[-1]["measures"]["placed"])
            if over:
                break
        # Within 0.15 m of the goal and ten steps at rest; the hand is at rest all the time.
        assert over == wins
        assert not any(map(any, paid[:10]))
        assert paid[-1] == ((5.0, 20.0) if wins else (0.0, 0.0))
        assert held(env) is None


def test_place_may_let_go_elsewhere_and_take_up_the_object_or_another_which_costs(make):
    index = first_episode(make("HabPlace-v1"), lambda e: len(e.objects) > 1)
    env = start(make, "HabPlace-v1", index)
    goal_at(env, (0.0, 2.0, 0.0))
    (episode,) = env.unwrapped.episode
    target = episode.targets[0].object
    other = next(name for name in sorted(episode.objects) if name != target)
    for taken, away, paid in ((target, other, 0.0), (other, target, -5.0)):
        assert not ended(env.step(ee_grip(env, -1.0)))[0]
        assert held(env) is None
        put(env, away, (0.0, 0.0, 0.6))
        put(env, taken, (0.0, 0.0, -0.1))
        over, terms = ended(env.step(ee_grip(env)))
        assert held(env) == taken
        assert not over
        assert terms["wrong_object"] == paid
        assert ended(env.step(ee_grip(env)))[1]["wrong_object"] == 0.0


@pytest.mark.parametrize("env_id", FRIDGES)
def test_leaving_the_region_before_the_fridge_ends_the_episode(make, env_id):
    """0.933 to 1.833 m before the fridge, 0.6 m to either side."""
    env = start(make, env_id)
    base = env.unwrapped
    fridge = base.simulation.grasp.handles[base.simulation.handles[0]].furniture
    pose = fridge.pose.to_transformation_matrix()[0].numpy()
    ahead = pose[:2, 0] / np.linalg.norm(pose[:2, 0])
    back = still(env)
    back[-2] = -1.0
    for _ in range(60):
        over, terms = ended(step := env.step(back))
        offset = np.asarray(base.simulation.snapshot.base)[0, :2] - pose[:2, 3]
        x, y = offset @ ahead, offset @ (-ahead[1], ahead[0])
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
        state["hab"]["tracker"]["grabbed_before"][:] = True
        base.set_state_dict(state)
        step = env.step(still(env))
        assert float(base.simulation.snapshot.joints[0, 0]) == pytest.approx(position, abs=2e-3)
        over, terms = ended(step)
        assert bool(step[-1]["success"]) == over == done
        assert terms["success"] == 10.0 * done
    # The hand has to be at rest.
    env = start(make, env_id)
    play(env, [np.eye(len(still(env)))[2]] * 15)
    assert float(env.unwrapped.measures.ee_to_rest_m[0]) > 0.15
    state = env.unwrapped.get_state_dict()
    move_joint(state, env, 0, just)
    env.unwrapped.set_state_dict(state)
    assert not ended(env.step(still(env)))[0]


FORWARDS, LEFT, RIGHT = (BASE_CELLS.index(cell) for cell in ((0.5, 0.0), (0.0, 0.5), (0.0, -0.5)))


def navigate_at(make, offset_m, turn_rad, **options):
    """A start of Navigate with the robot beside its goal."""
    env = start(make, "HabNavigate-v1", **options)
    base = env.unwrapped
    x, y, yaw = base.episode[0].navigation.base
    state = base.get_state_dict()
    # Away from what the goal looks at, where the floor is free.
    x, y = x - offset_m * math.cos(yaw), y - offset_m * math.sin(yaw)
    move_base(state, env, x, y, yaw + turn_rad)
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


def test_arriving_ends_navigate_only_where_the_stop_is_not_learned(make):
    env = navigate_at(make, 0.0, 0.0)
    for cell in (LEFT, RIGHT):
        step = env.step(cell)
        assert not ended(step)[0]
        assert float(step[-1]["measures"]["base_to_goal_m"]) < 0.3
    assert ended(env.step(STOP_CELL))[0]
    env = navigate_at(make, 0.0, 0.0, skill_config={"learned_stop": 0})
    over, terms = ended(env.step(LEFT))
    assert over
    assert terms["success"] == 10.0


def test_navigate_holds_what_it_starts_with_and_leaves_doors(make):
    index = first_episode(make("HabNavigate-v1"), lambda e: e.held is not None)
    env = start(make, "HabNavigate-v1", index, obs_mode="state_dict")
    name, before = held(env), joints(env)
    assert name is not None
    for cell in (LEFT, FORWARDS) * 5:
        obs, *_ = env.step(cell)
        assert held(env) == name
        assert float(obs["agent"]["is_holding"]) == 1.0
    assert same(joints(env), before, atol=1e-3)
