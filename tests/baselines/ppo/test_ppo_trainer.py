"""Whole runs in the toy environment: files, exact resume, collapse, agents and commands."""

import json
from dataclasses import replace

import pytest
import torch
from hab_ppo import checkpoint
from hab_ppo.cli import main
from hab_ppo.config_json import from_json, to_json
from hab_ppo.distributed import Ranks
from hab_ppo.progress import Recent, read_progress
from hab_ppo.recipe import Recipe
from hab_ppo.recipes import find_recipe, recipe_names
from hab_ppo.trainer import BEST, LAST, Trainer, TrainPlan
from refusals import check_each, refused_by_call, refused_by_command
from toy_examples import TOY, replace_simulator


@pytest.fixture
def toy(monkeypatch):
    """Replaces the simulator by the toy; returns the lines of each run."""
    replace_simulator(monkeypatch)
    lines = []

    def train(out, recipe=TOY, **options):
        out.mkdir(exist_ok=True)
        return Trainer(TrainPlan(recipe=recipe, out=out, **options), Ranks(), lines.append).run()

    train.lines = lines
    return train


def test_a_run_writes_its_files_and_says_how_it_goes(toy, tmp_path):
    end = toy(tmp_path)
    assert end.steps >= TOY.total_steps
    assert json.loads((tmp_path / "recipe.json").read_text())["name"] == "toy"
    entries = read_progress(tmp_path)
    assert [entry["update"] for entry in entries] == list(range(1, end.update + 1))
    assert sum("eval/success" in entry for entry in entries) == 3
    assert entries[-1]["eval/best"] == end.best_success
    assert 0 < entries[-1]["time/env"] + entries[-1]["time/update"] <= 1
    assert list((tmp_path / "tensorboard").iterdir())
    assert "success" in toy.lines[0]
    tensors, about = checkpoint.load(tmp_path / BEST)
    assert about["position"]["best_steps"] == end.best_steps
    assert all(name.startswith("network/") for name in tensors)


def test_a_run_continues_only_as_it_was(toy, tmp_path):
    toy(tmp_path)
    other = replace(TOY, preset=replace(TOY.preset, rows=3))
    refused_by_call(lambda: toy(tmp_path, other, resume=LAST), "another preset")
    refused_by_call(lambda: toy(tmp_path, seed=1, resume=LAST), "seed 0, not 1")


def test_a_collapse_is_reported_and_the_best_weights_are_kept(toy, tmp_path, monkeypatch):
    told = iter([{"eval/success": rate, "eval/return": 0.0} for rate in (0.2, 0.8, 0.3)])
    monkeypatch.setattr(Trainer, "_evaluated", lambda self: next(told))
    end = toy(tmp_path)
    assert (end.best_success, end.success) == (0.8, 0.3)
    assert [line for line in toy.lines if "fell from 80% " in line and "to 30%" in line]
    assert checkpoint.load(tmp_path / BEST)[1]["position"]["steps"] == end.best_steps < end.steps


def test_recent_episodes_span_the_updates_that_hold_a_hundred():
    recent = Recent()
    for success in (0, 0, 30, 60):
        recent.add([60, success, 60.0, 600])
    # The last two updates hold 120 episodes, 90 of them solved.
    assert recent.metrics["train/success"] == pytest.approx(0.75)
    assert recent.metrics["train/length"] == pytest.approx(10)
    stages = Recent(["pick_1", "place_1"])
    stages.add([4, 1, 0.0, 40, 3, 2])
    assert stages.metrics["train/stage/pick_1"] == 0.75
    assert stages.metrics["train/stage/place_1"] == 0.5


def test_recipes_are_json_and_named_after_their_files():
    for name in recipe_names():
        recipe = find_recipe(name)
        assert recipe.name == name
        assert from_json(Recipe, json.loads(json.dumps(to_json(recipe)))) == recipe
        assert recipe.preset.rows >= recipe.preset.ppo.minibatches, name


def test_own_recipes_are_found_by_module(tmp_path, monkeypatch):
    source = "from hab_ppo.recipes.pick_blind import RECIPE\nMINE = RECIPE\n"
    (tmp_path / "my_recipes_of_test.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    assert find_recipe("my_recipes_of_test:MINE").name == "pick_blind"
    refused_by_call(lambda: find_recipe("my_recipes_of_test:MIEN"), "MINE")
    refused_by_call(lambda: find_recipe("no_such_module:MINE"), "cannot be imported")


def test_files_that_cannot_be_used_say_so_in_a_line(tmp_path):
    file = tmp_path / "weights.safetensors"
    refused_by_call(lambda: checkpoint.load(file), "cannot be read")
    file.write_bytes(b"nonsense")
    refused_by_call(lambda: checkpoint.load(file), "not a file of weights")
    checkpoint.save(file, {"network/x": torch.zeros(1)}, {"format": 99})
    refused_by_call(lambda: checkpoint.load(file), "format 99")


def test_bad_input_is_reported_in_one_line(tmp_path):
    full = tmp_path / "full"
    full.mkdir()
    (full / "thesis.txt").write_text("mine")
    cases = {
        "train pick_blnd --out DIR": "Did you mean 'pick_blind'",
        "train pick_blind --out DIR --preset slow": "Unknown preset",
        "train pick_blind --out DIR --ranks 0": "--ranks",
        "train pick_blind --out DIR --rows 3": "--rows",
        "train pick_blind --out DIR --resume": "there is no run",
        "train pick_blind --out DIR --exact": "--exact",
        "train pick_blind --out FULL": "--force does not replace it",
        "eval none.safetensors": "cannot be read",
        "plot DIR": "progress.jsonl",
    }
    names = {"DIR": tmp_path / "out", "FULL": full}

    def check(line):
        arguments = [names.get(word, word) for word in line.split()]
        refused_by_command(main, arguments, cases[line])

    check_each({line: line for line in cases}, check)
