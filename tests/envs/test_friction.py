"""The option `grasp`: another hand, other observations and episodes, and a planner for it."""

import numpy as np
import pytest
from hab_eval.cli import main
from hab_eval.records.config import EvalConfig
from hab_eval.records.results import read_record
from hab_eval.run.environments import setup_of
from playing import slow

from hab_tasks.agent import AgentSpec
from hab_tasks.errors import EpisodeError, OptionError, UnknownNameError
from hab_tasks.robots.fetch import FETCH, FETCH_FRICTION
from hab_tasks.robots.spec import with_grasp
from hab_tasks.world.scenes.habitat.dataset import resolve_dataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.handle_bars import with_bars


def test_the_option_selects_the_hand(make):
    assert with_grasp(FETCH, "friction") is FETCH_FRICTION
    assert with_grasp(FETCH_FRICTION, "snap") is FETCH
    with pytest.raises(UnknownNameError, match="friction, snap"):
        make(grasp="glue")
    with pytest.raises(OptionError, match="'joint_state'"):
        make(grasp="friction", control_mode="joint_state", episodes=None)
    with pytest.raises(EpisodeError, match="made for the robot hab_fetch, not for hab_fetch_fr"):
        make(grasp="friction")
    env = make(grasp="friction", episodes=None, obs_mode="state_dict")
    obs, _ = env.reset(seed=0)
    assert np.allclose(obs["agent"]["fingers"], FETCH_FRICTION.fingers.open_m)
    assert env.unwrapped.episode[0].id.split("/")[2].endswith("+hab_fetch_friction")
    state = env.unwrapped.get_state_dict()
    env.step(env.action_space.sample())
    env.unwrapped.set_state_dict(state)
    again = env.unwrapped.get_obs(env.unwrapped.get_info())
    assert np.allclose(again["agent"]["fingers"], FETCH_FRICTION.fingers.open_m, atol=1e-6)


def test_a_held_object_stays_between_the_fingers(make):
    env = make("HabPlace-v1", grasp="friction", episodes=None, num_episodes=3)
    simulation = env.unwrapped.simulation
    for episode in range(3):
        env.reset(options={"episode": episode})
        before = simulation.grasp.held
        assert simulation.held_name() == simulation.episode.held
        for _ in range(20):
            env.step(env.unwrapped.agent.controller.idle_action(holding=True))
        assert simulation.grasp.held == before
        # From the hand, as the arm is still: the object has not slid.
        moved_m = simulation.snapshot.objects_m[0, 0] - simulation.goals.starts_m[0, 0]
        assert np.linalg.norm(moved_m) < 0.01
        assert float(env.unwrapped.measures.force_total_n[0]) == 0.0


def test_agents_are_set_up_for_it():
    config = EvalConfig(agent="x:y", env="HabPick-v1", env_options={"grasp": "friction"})
    setup = setup_of(config)
    assert setup.robot == FETCH_FRICTION.uid
    spaces = setup.spaces(AgentSpec(name="x", control_mode="ee"))
    assert spaces.observation["agent"]["fingers"].shape == (2,)
    with pytest.raises(UnknownNameError, match="Did you mean 'fetch'"):
        setup_of(EvalConfig(agent="x:y", env="HabPick-v1", env_options={"robot": "hab_fetsh"}))


@pytest.mark.assets
def test_handles_without_a_bar_get_one(replica_cad):
    v3 = "v3_sc0_staging_00"
    plain, mended = (load_scene(resolve_dataset(name), v3) for name in ("apartment", replica_cad))
    assert with_bars(plain) == plain
    bars = {b.link: b for one in with_bars(mended).articulations for b in one.bars}
    # ReplicaCAD's seven drawers and its fridge; the box of the fridge's door ends at 6.15 cm.
    assert len(bars) == 8
    assert bars["top_door"].middle_m == pytest.approx((0.0615 + 0.0385, -0.62, 0.2), abs=1e-3)
    assert bars["top_door"].length_m == 0.52


@slow
@pytest.mark.parametrize(
    "env", ["HabPick-v1", "HabOpenDrawer-v1", "HabCloseDrawer-v1", "HabOpenFridge-v1"]
)
def test_a_planner_picks_and_moves_doors_and_drawers_with_two_fingers(tmp_path, env):
    out = tmp_path / "run"
    command = f"run --agent hab_spa:spa_priv --option planner=batched --env {env} --split val"
    options = "--seed 11 --episodes 3 --env-option grasp=friction --workers 1 --out"
    assert main([*command.split(), *options.split(), str(out)]) == 0
    record = read_record(out / "run.json")
    assert record.env_options == {"grasp": "friction"}
    assert sum(episode.success for episode in record.episodes) >= 2


@slow
def test_a_planner_plays_a_task_with_two_fingers(tmp_path):
    out = tmp_path / "run"
    command = "run --agent hab_spa:tp_spa_priv --option planner=batched --env HabTidyHouse-v1"
    options = "--split val --seed 0 --episodes 1 --env-option grasp=friction --workers 1 --out"
    assert main([*command.split(), *options.split(), str(out)]) == 0
    assert read_record(out / "run.json").episodes[0].success
