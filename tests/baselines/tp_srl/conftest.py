"""Untrained weights of every skill, in the files that training writes."""

from pathlib import Path

import pytest
from hab_ppo.recipes import find_recipe, recipe_names
from untrained import write_weights

from hab_tasks.registration import SKILLS


@pytest.fixture(autouse=True)
def _nothing_ships(monkeypatch, tmp_path):
    """Whether weights ship for a recipe is not what these tests are about."""
    monkeypatch.setattr("hab_ppo.agent.WEIGHTS", tmp_path)


@pytest.fixture(scope="session")
def weights(tmp_path_factory) -> dict[str, Path]:
    """Recipe -> file of untrained weights."""
    folder = tmp_path_factory.mktemp("weights")
    found = {}
    for name in recipe_names():
        recipe = find_recipe(name)
        if recipe.env.env in SKILLS:
            found[name] = folder / f"{name}.safetensors"
            write_weights(recipe, found[name])
    return found


@pytest.fixture(scope="session")
def learned(weights) -> dict[str, str]:
    """Options of a team that learned everything, navigation too."""
    skills = {n.removesuffix("_blind"): str(f) for n, f in weights.items() if n.endswith("_blind")}
    return {**skills, "navigation": "learned"}
