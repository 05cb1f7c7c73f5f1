"""Suite plan: its rows, and the planner's model compared with the simulator in real episodes."""

import gymnasium as gym
import numpy as np
import pytest
from hab_eval.bench.suite import BenchOptions
from hab_spa.bench_episode import EPISODES, episode_rows
from hab_spa.bench_plan import SUITE, PlanSplit, PlanTiming, plan_rows, run_plan, split_rows
from hab_spa.planning.validity import Agreement, SimulatorCheck, StateDictCheck, agreement
from hab_spa.skills.fridge.base_poses import BasePoseSearch

from hab_tasks.robots.fetch import FETCH


def test_rows_hold_plans_beside_bounds_and_the_reference():
    costs = {"checks": 1000, "check_s": 5e-5, "joints_check_s": 5e-4, "state_check_s": 1e-3}
    parts = {"model_s": 0.0, "ik_s": 0.0, "search_s": 0.0, "simplify_s": 0.0}
    splits = [PlanSplit(goals_s=seconds, **parts) for seconds in (0.1, 0.2, 0.3)]
    timings = [PlanTiming(splits={"ompl": split, "batched": split}, **costs) for split in splits]
    agreed = Agreement(poses=200, touching=80, disagreements=4, far=1)
    rows = {row.name: row for row in plan_rows(("plan", "apartment", "Env"), timings, agreed)}
    found = {name.split("/")[-1]: row for name, row in rows.items()}
    assert found["median"].value == pytest.approx(0.2)
    # Linear between the ranks: 0.95 of the way from the first to the last is 0.9 from the middle.
    assert found["percentile_95"].value == pytest.approx(0.29)
    # A thousand checks of 1 ms instead of 0.05 ms: 0.95 s more each.
    assert found["state_set"].reference_value == pytest.approx(1.15)
    assert found["speedup"].value == pytest.approx(1.15 / 0.2)
    assert found["check_state"].ratio == pytest.approx(0.05)
    assert found["validity"].value == pytest.approx(98.0)
    assert found["validity_near"].value == pytest.approx(75.0)
    rows = {row.name: row for row in split_rows(("plan", "apartment", "Env"), timings)}
    assert rows["plan/apartment/Env/batched_goals_median"].ratio == pytest.approx(1.0)


@pytest.fixture
def make(request):
    """Makes an environment on the apartment or on the real data."""

    def make(env_id, dataset="apartment"):
        options = {"scene_dataset": dataset}
        if dataset == "real":
            names = {"scene_dataset": "replica_cad", "objects": "ycb"}
            options = {key: request.getfixturevalue(name) for key, name in names.items()}
        return gym.make(
            f"hab_tasks:{env_id}", obs_mode="state_dict", render_backend="none", **options
        )

    return make


slow, long, assets = pytest.mark.slow, pytest.mark.long, pytest.mark.assets
scenes = pytest.mark.parametrize(
    ("env_id", "dataset"),
    [
        pytest.param("HabPick-v1", "apartment", marks=slow),
        pytest.param("HabPlace-v1", "real", marks=(slow, assets)),
        pytest.param("HabPick-v1", "real", marks=(long, assets)),
    ],
)
POSES = 2000


@pytest.fixture
def agreed(generated, make, env_id, dataset):
    """Agreement of the planner's model with the simulator in an episode."""
    _, episodes = generated(env_id, dataset)
    env = make(env_id, dataset)
    env.reset(seed=episodes[0].seed, options={"episode": episodes[0]})
    agreed = agreement(env, POSES, seed=0)
    env.close()
    assert 100 < agreed.touching < 1900
    assert agreed.percent >= 99.0
    return agreed


@scenes
@pytest.mark.usefixtures("persistent_contacts")
def test_the_model_agrees_with_persistent_contacts(agreed):
    assert agreed.far == 0


@scenes
def test_the_model_agrees_with_the_environments(agreed):
    # Without persistent contacts, PhysX misses up to 13 mm of overlap in 2 of 400 poses in
    # `test_spa_collision` (docs/deviations.md), here in 1 (apartment) or 1 to 3 (real) of 2000.
    assert agreed.far <= 0.0015 * POSES


@slow
def test_both_ways_to_set_the_state_say_the_same_and_the_scene_stays(generated, make):
    _, episodes = generated("HabPick-v1")
    env, said = make("HabPick-v1"), []
    poses = np.random.default_rng(0).uniform(-1.5, 1.5, (200, 7))
    for kind in (StateDictCheck, SimulatorCheck):
        env.reset(seed=episodes[0].seed, options={"episode": episodes[0]})
        before, check = env.unwrapped.privileged()[0].world_from_body, kind(env)
        said += [[check.is_free(pose) for pose in poses] for _ in range(2)]
        assert check.is_free(np.array(FETCH.rest_qpos_rad))
    after = env.unwrapped.privileged()[0].world_from_body
    still = [name for name in before if not name.startswith("hab_fetch/")]
    assert max(np.abs(before[name] - after[name]).max() for name in still) < 0.001
    env.close()
    assert said == [said[0]] * 4
    assert 20 < sum(said[0]) < 180


@long
@assets
def test_suite_plan_measures_the_apartment_and_each_scene(replica_cad, ycb):
    options = BenchOptions(suite=SUITE, scene_dataset=replica_cad, objects=ycb, steps=2)
    told = []
    rows = run_plan(options, told.append)
    assert {row.name.split("/")[1] for row in rows} == {"apartment", "v3_sc0_staging_00"}
    assert len(told) == 5  # two layouts, three kinds of episodes
    assert all(row.value > 0 for row in rows)


@slow
def test_phases_of_an_episode_add_up_to_it():
    rows = episode_rows(lambda line: None, EPISODES[:1], count=1)
    found = {row.name.split("/")[-1].removeprefix("spa_priv_"): row for row in rows}
    whole, planning = found.pop("episode"), found.pop("planning")
    assert sum(row.value for row in found.values()) == pytest.approx(whole.value)
    beside = found["environment"].value + found["other"].value
    assert planning.value == pytest.approx(whole.value - beside)
    # A door is opened by one choice of a base pose, arcs from it, and paths of the arm.
    assert {"base_poses", "arc", "goals", "paths", "map"} <= set(found)
    assert BasePoseSearch.choose.__name__ == "choose"  # and is no longer timed
