"""Goals and paths of the arm: every edge is checked by replay; and its kinematics."""

from dataclasses import replace
from itertools import product

import numpy as np
import pinocchio as pin
import pytest
from hab_plans.motion import Failure
from hab_spa.motion.robot import SpaConfig
from hab_spa.planning.arm_plan import PLANNERS, OmplPlanner, PlanConfig
from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.escape import EscapeConfig, escape
from hab_spa.planning.ik import BatchArm, CompiledArm, IkConfig, Tool
from hab_spa.planning.joint_goal import GoalConfig, sample_reaching_goals, sample_rest_goals
from hab_spa.planning.rrt import path_is_free
from hab_spa.scenes.true_scene import TrueScene, face_centres_m, standing_at

from hab_tasks.constants import GRASP_RADIUS_M
from hab_tasks.errors import UnknownNameError
from hab_tasks.robots.fetch import FETCH
from hab_tasks.robots.kinematics import arm_model
from hab_tasks.robots.panda_mobile import PANDA_MOBILE

REST = np.array(FETCH.rest_qpos_rad)
POSES = np.random.default_rng(0).uniform(FETCH.arm_lower_rad, FETCH.arm_upper_rad, (200, 7))


def sample(state, seed=0, config=None, arm=None):
    scene = TrueScene(FETCH)
    scene.see({"privileged": [state]}, 0)
    collision, points_m = scene.collision(), scene.grasp_points_m(0)
    goals = sample_reaching_goals(
        points_m, collision, arm or BatchArm(FETCH), seed, config or GoalConfig()
    )
    return collision, goals


def test_goals_grasp_the_target_and_are_free(table_scene):
    state = table_scene.privileged("target")
    _, result = sample(state)
    assert len(result)
    arm, fresh = BatchArm(FETCH), ArmCollision(FETCH, state)
    centres = face_centres_m(state, "target")
    for goal in result:
        point_m = (state.world_from_base @ arm.ee_pose(goal))[:3, 3]
        assert np.linalg.norm(centres - point_m, axis=1).min() <= GoalConfig().ik.tolerance_m
        nearest = min(
            state.object_com_m, key=lambda n: np.linalg.norm(state.object_com_m[n] - point_m)
        )
        assert nearest == "target"
        assert np.linalg.norm(state.object_com_m["target"] - point_m) < GRASP_RADIUS_M
        assert fresh.is_free(goal)
    distances = np.linalg.norm(result - REST, axis=1)
    assert np.all(np.diff(distances) >= 0)


def test_no_goal_reaches_a_blocked_target(make_scene):
    scene = make_scene()
    scene.add_box("target", "object", (0.8, 0.0, 0.8), (0.05, 0.05, 0.05))
    for axis, side in product(range(3), (-0.1, 0.1)):
        position, size = np.array([0.8, 0.0, 0.8]), np.full(3, 0.4)
        position[axis], size[axis] = position[axis] + side, 0.1
        scene.add_box(f"wall{axis}{side:+}", "static", tuple(position), tuple(size))
    _, result = sample(scene.privileged("target"), config=GoalConfig(starts_per_point=250))
    assert result.shape == (0, 7)


@pytest.mark.parametrize("planner", PLANNERS)
def test_paths_into_a_shelf_are_free_edge_by_edge_and_depend_on_the_seed_only(shelf_state, planner):
    config, results = SpaConfig().planned_by(planner, FETCH), []
    for seed in (5, 6, 5):
        collision, goals = sample(shelf_state, seed, arm=config.kinematics(FETCH))
        found = config.planner.plan(REST, goals, collision, seed=seed, limits=config.plan)
        results.append(found)
    # Replayed on a model of its own, without clearance and at a finer resolution.
    replay = ArmCollision(FETCH, shelf_state)
    replay.set_margin(0.0)
    for result in results[:2]:
        assert result.failure is None
        assert result.path is not None
        np.testing.assert_array_equal(result.path[0], REST)
        assert np.all(result.path >= FETCH.arm_lower_rad)
        assert np.all(result.path <= FETCH.arm_upper_rad)
        assert path_is_free(replay, result.path, 0.01)
    np.testing.assert_array_equal(results[0].path, results[2].path)
    assert results[0].checks == results[2].checks


class Split(ArmCollision):
    """The shoulder cannot pass through a band of its range: the ends are not connected."""

    def free_until(self, poses):
        free = super().free_until(poses)
        return next((i for i in range(free) if abs(poses[i, 0] - 0.3) <= 0.1), free)


def test_attempts_that_spend_no_checks_end(table_scene):
    class Blocked(OmplPlanner):
        connect = staticmethod(lambda *arguments: None)  # as from an end that is in contact

    collision = Split(FETCH, table_scene.privileged("target"))
    goal = REST + np.eye(7)[0] * 1.2
    config = PlanConfig(time_limit_s=20.0)
    result = Blocked().plan(REST, goal[None], collision, seed=0, limits=config)
    assert (result.failure, result.stopped_by) == (Failure.MOTION_PLAN, "checks")
    assert result.seconds < 20.0


def test_time_limit_is_honoured_and_a_motion_plan_failure(table_scene):
    collision = Split(FETCH, table_scene.privileged("target"))
    goal = REST + np.eye(7)[0] * 1.2
    # A fast machine makes the usual number of checks in less than that time.
    config = PlanConfig(time_limit_s=0.5, most_checks=10**9)
    result = OmplPlanner().plan(REST, goal[None], collision, seed=0, limits=config)
    assert result.path is None
    assert (result.failure, result.stopped_by) == (Failure.MOTION_PLAN, "time")
    assert 0.5 <= result.seconds < 30.0  # the machine may be busy


def test_bad_input_of_planners_is_told_in_one_line(table_scene):
    state = table_scene.privileged("target")
    with pytest.raises(UnknownNameError, match=r"Unknown planner 'prm'.*batched"):
        SpaConfig().planned_by("prm", FETCH)
    for goal in (REST + np.eye(7)[1] * 9.0, REST * np.nan):
        with pytest.raises(ValueError, match=r"goal 0: joint \w+ at \S+ rad is beyond"):
            OmplPlanner().plan(
                REST, goal[None], ArmCollision(FETCH, state), seed=0, limits=PlanConfig()
            )
    lost = {**state.world_from_body, "target": np.full((4, 4), np.nan)}
    for part, reason in (({"world_from_body": lost}, "pose is not"), ({"bodies": ()}, "no shapes")):
        with pytest.raises(ValueError, match=reason):
            ArmCollision(FETCH, replace(state, **part))


def test_a_model_whose_robot_is_put_elsewhere_is_the_model_of_there(table_scene):
    state = table_scene.privileged("target")
    moved = ArmCollision(FETCH, state)
    # What is moved in the world keeps its place there when the robot goes elsewhere.
    lift = np.eye(4)
    lift[2, 3] = 0.2
    moved.move("target", lift)
    for base in np.array(((0.1, -0.2, 0.3), (-0.1, 0.1, -0.2))):
        moved.stand_at(base)
        there = standing_at(state, base)
        lifted = {**there.world_from_body, "target": lift @ there.world_from_body["target"]}
        fresh = ArmCollision(FETCH, replace(there, world_from_body=lifted))
        free = [moved.is_free(pose) for pose in POSES]
        assert 0 < sum(free) < len(free)
        assert free == [fresh.is_free(pose) for pose in POSES]
        np.testing.assert_allclose(moved.arm_from_world, fresh.arm_from_world, atol=1e-12)


def test_held_object_escapes_from_the_table_and_comes_to_rest(table_scene):
    arm = BatchArm(FETCH)
    empty = table_scene.privileged("target")
    _, goals = sample(empty)
    table_scene.set_arm(goals[0])
    state = table_scene.privileged("target", held="target")
    collision = ArmCollision(FETCH, state, held="target")
    assert any("table" in c.first + c.second for c in collision.contacts(state.arm_qpos))
    way = escape(collision, arm, state.arm_qpos, EscapeConfig())
    assert len(way) > 1
    fresh = ArmCollision(FETCH, state, held="target")
    assert fresh.is_free(way[-1])
    assert np.all(np.diff([arm.ee_pose(pose)[2, 3] for pose in way]) > 0.005)
    rest = sample_rest_goals(fresh, arm, 0, GoalConfig())
    np.testing.assert_array_equal(rest, REST[None])


def test_rest_goals_near_a_blocked_rest_pose_bring_the_hand_near_rest(make_scene):
    scene = make_scene()
    # A rod where the fingers are in the resting pose.
    scene.add_box("rod", "static", (0.5, 0.0, 1.06), (0.02, 0.3, 0.02))
    scene.add_box("target", "object", (2.5, 0.0, 0.8), (0.05, 0.05, 0.05))
    collision = ArmCollision(FETCH, scene.privileged("target"))
    assert not collision.is_free(REST)
    arm = BatchArm(FETCH)
    result = sample_rest_goals(collision, arm, 0, GoalConfig())
    assert len(result)
    for goal in result:
        distance_m = np.linalg.norm(arm.ee_pose(goal)[:3, 3] - [0.5, 0.0, 1.0])
        assert distance_m < 0.10
        assert collision.is_free(goal)


# Kinematics of the arm -------------------------------------------------------------------------


TOOL = Tool(point_m=np.array((0.1, 0.0, 0.02)), up=np.eye(3)[2])


@pytest.mark.parametrize("robot", [FETCH, PANDA_MOBILE], ids=lambda robot: robot.uid)
def test_compiled_kinematics_agree_with_numpy(robot):
    numpy, compiled = BatchArm(robot), CompiledArm(robot)
    starts = numpy.random(np.random.default_rng(0), 200)
    targets_m = compiled.positions_m(starts[::-1])
    for tool in (None, TOOL):
        expected, reached = numpy.solve(starts, targets_m, IkConfig(), tool)
        poses, found = compiled.solve(starts, targets_m, IkConfig(), tool)
        np.testing.assert_allclose(poses, expected, atol=1e-9)
        np.testing.assert_array_equal(found, reached)


@pytest.mark.parametrize("robot", [FETCH, PANDA_MOBILE], ids=lambda robot: robot.uid)
def test_batch_agrees_with_pinocchio(robot):
    model, frame_id = arm_model(robot)
    data, arm = model.createData(), BatchArm(robot)
    poses = arm.random(np.random.default_rng(0), 200)
    positions, jacobians = arm.position_and_jacobian(poses)
    points_m, tilts_rad = arm.points_m(poses, TOOL), arm.tilts_rad(poses, TOOL)
    for i, pose in enumerate(poses):
        expected = pin.computeFrameJacobian(model, data, pose, frame_id, pin.LOCAL_WORLD_ALIGNED)
        ee = data.oMf[frame_id]
        np.testing.assert_allclose(positions[i], ee.translation, atol=1e-12)
        np.testing.assert_allclose(jacobians[i], expected[:3], atol=1e-12)
        np.testing.assert_allclose(points_m[i], ee.act(TOOL.point_m), atol=1e-12)
        np.testing.assert_allclose(np.cos(tilts_rad[i]), ee.rotation[2] @ TOOL.up, atol=1e-9)
