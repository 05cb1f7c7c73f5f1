"""Weights that ship: their files, size and cards."""

import json
import sys
from dataclasses import replace

import pytest
import torch
from hab_navigator import network as navigator
from hab_ppo import agent, cards, checkpoint, grounding_training, shipping
from hab_ppo.cards import NOT_EVALUATED, card, shipped_names
from hab_ppo.checkpoint import Position, position_json
from hab_ppo.cli import main
from hab_ppo.network import new_policy
from hab_ppo.observation import ObservationLayout
from hab_ppo.recipes import find_recipe
from refusals import check_each, refused_by_call
from stub_runs import make_record
from toy_vector import ToyVector

from hab_tasks.agent_spaces import agent_setup
from hab_tasks.typed_values import to_json


@pytest.fixture
def weights(monkeypatch, tmp_path):
    folder = tmp_path / "weights"
    for module in (agent, cards, shipping):
        monkeypatch.setattr(module, "WEIGHTS", folder)
    monkeypatch.setattr(navigator, "SHIPPED", tmp_path / "navigator")
    monkeypatch.setattr(grounding_training, "SHIPPED", tmp_path / "language.safetensors")
    return folder


@pytest.fixture
def run(tmp_path):
    """The folder of a run of pick_blind, with the toy's network."""
    env = ToyVector(1)
    layout = ObservationLayout.of(env.single_observation_space)
    recipe = find_recipe("pick_blind")
    policy = new_policy(layout, env.single_action_space, recipe.preset.network, 0)
    folder = tmp_path / "run"
    folder.mkdir()
    about = {
        "recipe": to_json(recipe),
        "seed": 3,
        "ranks": 2,
        "position": position_json(Position(steps=3200, best_steps=1600, best_success=0.62)),
        "origin": {"command": "hab-ppo train pick_blind", "device": "a machine", "git": "abc"},
    }
    checkpoint.save(folder / "best.safetensors", checkpoint.network_tensors(policy), about)
    progress = {"update": 2, "steps": 3200, "seconds": 1800.0, "eval/success": 0.62}
    (folder / "progress.jsonl").write_text(json.dumps(progress) + "\n")
    return folder


def test_a_card_states_what_the_files_say(weights, run, tmp_path, capsys):
    assert main(["ship", str(run)]) == 0
    assert shipped_names() == ["pick_blind"]
    text = card("pick_blind", [])
    assert NOT_EVALUATED in text
    assert "- Trained: `hab-ppo train pick_blind` (commit abc)" in text
    assert "- Steps: 3,200 in 0.50 h (a machine, 2 ranks); best at 1,600" in text
    record = replace(make_record([True, True, True, False]), agent="hab_ppo:pick_blind")
    other = replace(record, agent="hab_ppo:place_blind")
    lines = card("pick_blind", [other, record]).splitlines()
    assert ": 75.0 [30.1, 95.4] of 4;" in lines[-1]  # Wilson, 3 of 4
    assert not any("75.0" in line for line in lines[:-1])
    check = ["cards", "--check", "--submissions", str(tmp_path)]
    assert main(check) == 1
    assert "out of date: pick_blind" in capsys.readouterr().out
    assert main(["cards", "--submissions", str(tmp_path)]) == 0
    assert main(check) == 0


def test_what_ships_is_small_and_has_its_card():
    files = [*agent.WEIGHTS.glob("*.safetensors"), navigator.shipped_navigator()]
    assert sum(path.stat().st_size for path in files) <= 40e6
    assert main(["cards", "--check"]) == 0
    for name in shipped_names():
        assert (agent.WEIGHTS / f"{name}.png").is_file()
        _, about = checkpoint.load(agent.WEIGHTS / f"{name}.safetensors")
        assert about["recipe"]["name"] == name


def test_a_damaged_file_of_weights_is_refused_and_imports_nothing(tmp_path):
    tensors, about = checkpoint.load(agent.WEIGHTS / "pick_blind.safetensors")
    name = next(name for name, value in tensors.items() if value.is_floating_point())
    foreign = {**about["recipe"], "env": {**about["recipe"]["env"], "env": "no_module:HabNo-v1"}}

    def check(case):
        changed, told, word = case
        path = tmp_path / "weights.safetensors"
        checkpoint.save(path, tensors | {name: changed}, about | told)
        setup = agent_setup("HabPick-v1")
        refused_by_call(lambda: agent.PolicyAgent(setup, path), word)

    good = tensors[name]
    cases = (
        (good.to(torch.int32), {}, f"{name.removeprefix('network/')} differs"),
        (torch.full_like(good, torch.nan), {}, "not finite"),
        (good, {"recipe": None}, "no recipe of this version"),
        (good, {"recipe": foreign}, "was trained in HabNo-v1"),
    )
    check_each({case[2]: case for case in cases}, check)
    assert "no_module" not in sys.modules
