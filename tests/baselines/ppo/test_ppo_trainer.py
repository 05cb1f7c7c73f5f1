"""Whole runs in the toy environment: files, exact resume, collapse, agents and commands."""

import json
import shutil
from dataclasses import replace

import pytest
import torch
from hab_ppo import checkpoint, curves
from hab_ppo.cli import main
from hab_ppo.config_json import from_json, to_json
from hab_ppo.distributed import Ranks
from hab_ppo.errors import PolicyFileError, RecipeError
from hab_ppo.plan import CLONED
from hab_ppo.progress import Recent, read_progress
from hab_ppo.recipe import PAPER, Recipe
from hab_ppo.recipes import find_recipe, recipe_names
from hab_ppo.trainer import BEST, EXACT, LAST, Trainer, TrainPlan
from toy_examples import TOY, replace_simulator, same_tensors

from hab_tasks.errors import HabError, UnknownNameError


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


def test_a_resumed_run_equals_one_that_was_never_interrupted(toy, tmp_path):
    whole, started = tmp_path / "whole", tmp_path / "started"
    toy(whole)
    # The first part ends at its second evaluation, where both checkpoints are the same.
    toy(started, replace(TOY, total_steps=800))
    assert not same_tensors(whole / LAST, started / LAST)
    for name in (LAST, EXACT):
        parts = tmp_path / name
        shutil.copytree(started, parts)
        toy(parts, resume=name)
        assert same_tensors(whole / LAST, parts / LAST)
        assert same_tensors(whole / EXACT, parts / EXACT)
        numbers = [entry["update"] for entry in read_progress(parts)]
        assert numbers == [entry["update"] for entry in read_progress(whole)]


def test_a_run_continues_only_as_it_was(toy, tmp_path):
    toy(tmp_path)
    with pytest.raises(RecipeError, match="another preset"):
        toy(tmp_path, replace(TOY, preset=replace(TOY.preset, rows=3)), resume=LAST)
    with pytest.raises(RecipeError, match="seed 0, not 1"):
        toy(tmp_path, seed=1, resume=LAST)


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


def test_the_paper_s_numbers():
    ppo = PAPER.ppo
    assert (ppo.value_weight, ppo.entropy_weight, ppo.clip) == (0.1, 1e-4, 0.2)
    assert (ppo.epochs, ppo.minibatches, ppo.learning_rate, ppo.decays) == (2, 2, 1e-4, True)
    assert (ppo.max_gradient_norm, PAPER.network.lstm_size > 0) == (0.5, True)


def test_own_recipes_are_found_by_module(tmp_path, monkeypatch):
    source = "from hab_ppo.recipes.pick_blind import RECIPE\nMINE = RECIPE\n"
    (tmp_path / "my_recipes_of_test.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    assert find_recipe("my_recipes_of_test:MINE").name == "pick_blind"
    with pytest.raises(UnknownNameError, match="MINE"):
        find_recipe("my_recipes_of_test:MIEN")
    with pytest.raises(HabError, match="cannot be imported"):
        find_recipe("no_such_module:MINE")


def test_files_that_cannot_be_used_say_so_in_a_line(tmp_path):
    file = tmp_path / "weights.safetensors"
    with pytest.raises(PolicyFileError, match="cannot be read"):
        checkpoint.load(file)
    file.write_bytes(b"nonsense")
    with pytest.raises(PolicyFileError, match="not a file of weights"):
        checkpoint.load(file)
    checkpoint.save(file, {"network/x": torch.zeros(1)}, {"format": 99})
    with pytest.raises(PolicyFileError, match="format 99"):
        checkpoint.load(file)


def test_bad_input_is_reported_in_one_line(tmp_path, capsys):
    full, wrong = tmp_path / "full", []
    full.mkdir()
    (full / "thesis.txt").write_text("mine")
    names = {"DIR": str(tmp_path / "out"), "FULL": str(full)}
    for arguments, message in (
        (["train", "pick_blnd", "--out", "DIR"], "Did you mean 'pick_blind'"),
        (["train", "pick_blind", "--out", "DIR", "--preset", "slow"], "Unknown preset"),
        (["train", "pick_blind", "--out", "DIR", "--ranks", "0"], "--ranks"),
        (["train", "pick_blind", "--out", "DIR", "--rows", "3"], "--rows"),
        (["train", "pick_blind", "--out", "DIR", "--resume"], "there is no run"),
        (["train", "pick_blind", "--out", "DIR", "--exact"], "--exact"),
        (["train", "pick_blind", "--out", "FULL"], "--force does not replace it"),
        (["eval", "none.safetensors"], "cannot be read"),
        (["eval", "DIR", "--episodes", "0"], "--episodes"),
        (["plot", "DIR"], "progress.jsonl"),
    ):
        code = main([names.get(word, word) for word in arguments])
        told = capsys.readouterr().err
        if code != 2 or message not in told or told.count("\n") != 1:
            wrong.append((arguments, told))
    assert not wrong


def test_list_names_every_recipe(capsys):
    assert main(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == recipe_names()


def test_plot_draws_the_curves_of_runs(toy, tmp_path, capsys):
    toy(tmp_path / "one", replace(TOY, total_steps=400))
    shutil.copytree(tmp_path / "one", tmp_path / "two")
    out = tmp_path / "curves.png"
    assert main(["plot", str(tmp_path / "one"), str(tmp_path / "two"), "--out", str(out)]) == 0
    assert out.read_bytes().startswith(b"\x89PNG")
    assert main(["plot", str(tmp_path / "one"), "--out", str(out)]) == 2
    assert "--force" in capsys.readouterr().err
    assert main(["plot", str(tmp_path / "one"), "--minutes"]) == 0


def test_wall_time_includes_a_warm_start(tmp_path):
    (tmp_path / "progress.jsonl").write_text('{"steps": 100, "seconds": 30.0, "eval/success": 1}\n')
    assert curves.over_minutes(tmp_path) == [{"steps": 0.5, "seconds": 30.0, "eval/success": 1}]
    checkpoint.save(tmp_path / CLONED, {}, {"seconds": 90.0})
    assert curves.over_minutes(tmp_path)[0]["steps"] == 2.0
