"""The sides from which the hand can come, and base poses at the fridge."""

import gymnasium as gym
import numpy as np
import pytest
from hab_experts import cavity_around
from hab_plans.plan import plan_of
from hab_plans.problem import task_of
from hab_plans.stage import stage_of
from hab_spa.motion.robot import Robot, SpaConfig
from hab_spa.scenes.true_scene import TrueScene
from hab_tp_srl.base_poses import SIDES, candidates, open_sides

from hab_tasks.receptacles import FRIDGE
from hab_tasks.robots.fetch import FETCH

INSIDE_M = np.array((2.0, 3.0, 1.2))


def add_cupboard(fetch, opening_m):
    """A cupboard around `INSIDE_M` that is open towards +x, `opening_m` wide and 0.4 m high."""
    x, y, z = INSIDE_M
    aside = opening_m / 2 + 0.05
    for name, centre_m, size_m in (
        ("back", (x - 0.25, y, z), (0.1, 1.0, 0.6)),
        ("left", (x, y + aside, z), (0.5, 0.1, 0.6)),
        ("right", (x, y - aside, z), (0.5, 0.1, 0.6)),
        ("floor", (x, y, z - 0.1), (0.5, 1.0, 0.1)),
        ("roof", (x, y, z + 0.35), (0.5, 1.0, 0.1)),
    ):
        fetch.add_box(name, "static", centre_m, size_m)
    fetch.add_box("clutter", "object", (x + 0.15, y, z), (0.06, 0.06, 0.06))


# The side walls reach 0.25 m ahead of the place and begin 0.25 m beside it. The capsule's axis
# passes their front corners at a distance of 0.25 * (cos a - sin a) m: 0.18 m at 15 degrees,
# 0.09 m at 30, where it just fits, and 0 at 45. Objects do not count. Where the opening is 0.14 m
# wide, the capsule of 0.09 m does not fit, and one of 0.05 m is tried.
@pytest.mark.parametrize(
    ("opening_m", "degrees"),
    [(0.5, [0, 15, 30, 330, 345]), (0.14, [0]), (None, list(range(0, 360, 360 // SIDES)))],
)
def test_the_hand_comes_through_the_opening_only(make_scene, opening_m, degrees):
    fetch = make_scene()
    fetch.add_box("apple", "object", tuple(INSIDE_M), (0.06, 0.06, 0.06))
    if opening_m:
        add_cupboard(fetch, opening_m)
    free = open_sides(fetch.privileged("apple"), INSIDE_M)
    assert [360 * side // SIDES for side in np.flatnonzero(free)] == degrees


@pytest.mark.parametrize(
    "dataset", ["apartment", pytest.param("real", marks=[pytest.mark.assets, pytest.mark.slow])]
)
def test_bases_at_the_fridge_are_before_it(dataset, request):
    options = {"scene_dataset": "apartment", "split": "val"}
    if dataset == "real":
        data = request.getfixturevalue("data")
        options = {"scene_dataset": str(data / "replica_cad"), "objects": str(data / "ycb")}
    env_id = "HabPrepareGroceries-v1"
    task, stages = task_of(env_id), []
    for action in plan_of(env_id).actions:
        if action.name in ("pick", "place"):
            stage = stage_of(task, action)
            target = task.spec.targets[stage.object]
            if (target.start if stage.at == "start" else task.spec.goal_of(target)) == (FRIDGE,):
                stages.append(stage)
    env = gym.make(f"hab_tasks:{env_id}", control_mode="joint_target_base", **options)
    try:
        for seed in range(3):
            env.reset(seed=seed)
            scene = TrueScene(FETCH)
            scene.see({"privileged": env.unwrapped.privileged()}, 0)
            robot = Robot(scene, SpaConfig(), seed=0, deadline=500)
            fridge = cavity_around(env.unwrapped.simulation, (FRIDGE, None))
            assert fridge is not None
            assert len(stages) == 3
            for stage in stages:
                place_of = scene.object_m if stage.at == "start" else scene.goal_m
                point = place_of(stage.object)
                first, _ = candidates(robot, stage, scene.floor_map(), point)
                assert len(first)
                # Up to 60 degrees: a place at the side of the fridge is reached at a slant.
                assert (
                    np.cos(first[:, 2] - fridge.frame[2] - np.pi) > np.cos(np.deg2rad(60.0))
                ).all()
    finally:
        env.close()
