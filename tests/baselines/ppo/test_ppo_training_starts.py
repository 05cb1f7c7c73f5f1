"""Environments for training: often at the fridge, with objects as a pick leaves them, crowded."""

from dataclasses import replace
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from hab_ppo.episodes import prepare_episodes, training_request
from hab_ppo.picked_objects import OFF_HAND_M, PlacePickedEnv, rests_at_goal
from hab_ppo.recipes import find_recipe
from hab_ppo.warm_start import make_rows

from hab_tasks.episodes import load_episodes
from hab_tasks.receptacles import FRIDGE

COUNT = 24
RECIPES = ("pick_fridge", "pick_crowded", "place_fridge", "place_picked")


@pytest.mark.parametrize("name", RECIPES)
def test_half_of_the_start_states_are_at_the_fridge(name):
    request = training_request(find_recipe(name))
    targets = [episode.targets[0] for episode in load_episodes(request, COUNT).episodes]
    receptacles = [one.start or one.goal for one in targets]
    # 1/2 and 1/6 or 1/7 of the others are expected: 14 of 24, with a standard deviation of 2.4.
    at_fridge = sum(ref is not None and ref[0] == FRIDGE for ref in receptacles)
    assert 6 <= at_fridge <= 22


def test_evaluations_are_in_the_environment_of_the_skill():
    recipe = find_recipe("pick_fridge")
    few = replace(recipe, env=replace(recipe.env, num_episodes=2), evaluation_episodes=2)
    episodes = prepare_episodes(few, 1, lambda line: None)
    assert {episode.id.split("/")[0] for episode in episodes} == {"HabPick-v1"}


@pytest.mark.parametrize("name", RECIPES)
def test_policies_of_these_environments_are_policies_of_the_skill(name):
    recipe = find_recipe(name)
    assert recipe.env.trained_in is not None
    rows = make_rows(recipe, 2, 1)
    skill = make_rows(replace(recipe, env=replace(recipe.env, trained_in=None)), 2, 1)
    try:
        assert rows.spec.id == recipe.env.trained_in.rpartition(":")[2]
        assert rows.single_observation_space == skill.single_observation_space
        assert rows.single_action_space == skill.single_action_space
    finally:
        rows.close()
        skill.close()


def started(name, episode):
    """The simulation at the start of a training episode, and its observation."""
    env = gym.make(find_recipe(name).env.training_reference, obs_mode="state_dict", split="train")
    obs, _ = env.reset(options={"episode": episode})
    return env, obs


@pytest.mark.parametrize("episode", range(4))
def test_picked_objects_hang_off_the_hand_and_the_goal_is_seen_from_them(episode):
    env, obs = started("place_picked", episode)
    state, goals = env.unwrapped.simulation.snapshot, env.unwrapped.simulation.goals
    object_m, ee_m = np.asarray(state.objects_m[0, 0]), np.asarray(state.ee_m[0])
    assert int(state.held[0]) >= 0
    assert 0.0 < np.linalg.norm(object_m - ee_m) <= OFF_HAND_M + 1e-3
    assert object_m[2] < ee_m[2] + 1e-3
    # Along the axes of the base, heights are those of the world.
    seen_m = np.asarray(obs["extra"]["object_goal_from_ee"][0])
    gap_m = np.asarray(goals.goals_m[0, 0]) - object_m
    assert np.linalg.norm(seen_m) == pytest.approx(np.linalg.norm(gap_m), abs=1e-4)
    assert seen_m[2] == pytest.approx(gap_m[2], abs=1e-4)
    env.close()


def test_an_object_that_rolls_is_not_yet_placed():
    config = PlacePickedEnv.skill.config
    placed = SimpleNamespace(placed=np.array([True] * 3), ee_to_rest_m=np.array([0.1] * 3))
    placed.object_to_goal_m = np.array([0.05, 0.05, 0.12])
    placed.object_to_goal_decrease_m = np.array([0.0005, -0.004, 0.0])  # 4 mm a step are 12 cm/s
    assert rests_at_goal(None, placed, None, config).tolist() == [True, False, False]


def nearest_neighbour_m(name):
    """Mean distance from the target to the nearest other object over training episodes."""
    gaps = []
    for episode in load_episodes(training_request(find_recipe(name)), COUNT).episodes:
        target = np.array(episode.objects[episode.targets[0].object][:3])
        others = [o[:3] for n, o in episode.objects.items() if n != episode.targets[0].object]
        gaps.append(min((np.linalg.norm(target - other) for other in others), default=1.0))
    return np.mean(gaps)


def test_crowded_targets_have_nearer_neighbours():
    assert nearest_neighbour_m("pick_crowded") < 0.8 * nearest_neighbour_m("pick_fridge")
