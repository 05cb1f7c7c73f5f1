"""A scripted robot that sees everything opens and closes the fridge: both can be done as stated."""

import gymnasium as gym
import pytest
from oracles_fridge import FridgeRobot, close_fridge, open_fridge

import hab_tasks  # noqa: F401  # registers the environments

pytestmark = pytest.mark.slow
COUNT, NEEDED = 10, 9
SOLVERS = {"HabOpenFridge-v1": open_fridge, "HabCloseFridge-v1": close_fridge}


@pytest.fixture(autouse=True)
def fresh_episodes(monkeypatch, tmp_path):
    """Plays nothing that an older version has made."""
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path))


def solved(env_id: str, **options) -> tuple[int, list]:
    """Plays the first `COUNT` episodes; returns how many were solved, and what became of each."""
    env = gym.make(env_id, control_mode="ee_base", num_episodes=COUNT, **options)
    told = []
    for index in range(COUNT):
        env.reset(options={"episode": index})
        robot = FridgeRobot(env)
        SOLVERS[env_id](robot)
        why = [name for name, failed in robot.info["failures"].items() if failed]
        told.append((bool(robot.info["success"]), robot.steps, round(robot.joint_rad, 2), why))
    env.close()
    return sum(entry[0] for entry in told), told


@pytest.mark.parametrize("env_id", SOLVERS)
def test_an_oracle_moves_the_door_in_the_apartment(env_id):
    count, told = solved(env_id, split="val")
    assert count >= NEEDED, told


@pytest.mark.assets
@pytest.mark.parametrize("env_id", SOLVERS)
def test_an_oracle_moves_the_door_in_replica_cad(env_id, replica_cad, ycb):
    count, told = solved(env_id, scene_dataset=replica_cad, objects=ycb, split="train")
    assert count >= NEEDED, told
