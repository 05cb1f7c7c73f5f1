"""Whole runs in the toy environment: files, exact resume, collapse, agents and commands."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from hab_ppo import checkpoint, distillation, warm_start
from hab_ppo.agent import LoadedPolicy
from hab_ppo.cli import main
from hab_ppo.demonstration_file import write_examples
from hab_ppo.distributed import Ranks
from hab_ppo.network import new_policy
from hab_ppo.observation import ObservationLayout
from hab_ppo.plan import CLONED
from hab_ppo.progress import read_progress
from hab_ppo.recipe import Cloning, Distillation, FineTuning, NetworkConfig, WarmStart
from hab_ppo.recipes import find_recipe
from hab_ppo.trainer import BEST, EXACT, LAST, Trainer, TrainPlan, train_rank
from refusals import check_each, refused_by_call, refused_by_command
from toy_examples import TOY, linear, random_examples, replace_simulator, same_tensors
from toy_vector import ToyVector

WARM = replace(
    TOY,
    total_steps=960,
    evaluation_steps=320,
    warm_start=WarmStart(
        cloning=Cloning(epochs=3), rounds=0, tuning=FineTuning(critic_updates=3, kl_steps=1000)
    ),
)

ABOUT = {"agent": "", "seed": 0, "counts": {}}


@pytest.fixture
def toy(monkeypatch):
    """Trains in the toy, with made-up demonstrations; keeps the lines of each run."""
    env = ToyVector(1)
    layout = ObservationLayout.of(env.single_observation_space)
    teacher = new_policy(layout, env.single_action_space, NetworkConfig(), seed=1)

    def demonstrations(path, plan, write_line):
        examples = random_examples([12] * 20, linear, seed=plan.seed)
        write_examples(path, examples, [], plan.recipe.env, ABOUT)

    monkeypatch.setattr(warm_start, "write_demonstrations", demonstrations)
    monkeypatch.setattr(warm_start, "load_teacher", lambda *_: LoadedPolicy(teacher, TOY))
    monkeypatch.setattr(warm_start, "known_weights", lambda name, option: Path(name))
    replace_simulator(monkeypatch)
    lines = []

    def train(out, recipe=TOY, **options):
        out.mkdir(exist_ok=True)
        return train_rank(TrainPlan(recipe=recipe, out=out, **options), Ranks(), lines.append)

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
    assert main(["plot", str(tmp_path)]) == 0
    assert (tmp_path / "curves.png").read_bytes().startswith(b"\x89PNG")
    assert "success" in toy.lines[0]
    tensors, about = checkpoint.load(tmp_path / BEST)
    assert about["position"]["best_steps"] == end.best_steps
    assert all(name.startswith("network/") for name in tensors)


def test_a_collapse_is_reported_and_the_best_weights_are_kept(toy, tmp_path, monkeypatch):
    told = iter([{"eval/success": rate, "eval/return": 0.0} for rate in (0.2, 0.8, 0.3)])
    monkeypatch.setattr(Trainer, "_evaluated", lambda self: next(told))
    end = toy(tmp_path)
    assert (end.best_success, end.success) == (0.8, 0.3)
    assert [line for line in toy.lines if "fell from 80% " in line and "to 30%" in line]
    assert checkpoint.load(tmp_path / BEST)[1]["position"]["steps"] == end.best_steps < end.steps


def test_a_run_starts_from_given_weights(toy, tmp_path):
    first, second, third = tmp_path / "first", tmp_path / "second", tmp_path / "third"
    best = toy(first, WARM).best_success
    toy(second, replace(WARM, warm_start=None, total_steps=320), weights=first / BEST)
    start, *updates = read_progress(second)
    assert start["eval/success"] == best
    assert not any("update/start_kl" in entry for entry in updates)
    count = "network/state_normalizer.count"
    given, learned = checkpoint.load(first / BEST)[0], checkpoint.load(second / LAST)[0]
    assert learned[count] >= given[count] + 320
    # In a recipe with a warm start, they take the place of the clone.
    toy(third, replace(WARM, total_steps=320), weights=first / BEST)
    assert checkpoint.load(third / CLONED)[1]["made_from"] == {"weights": BEST}
    assert same_tensors(third / CLONED, first / BEST)
    assert "update/start_kl" in read_progress(third)[1]


def test_a_resumed_run_equals_one_that_was_never_interrupted(toy, tmp_path):
    whole = tmp_path / "whole"
    toy(whole, WARM)
    for name, steps in ((LAST, 320), (EXACT, 640)):  # in the warm-up, and afterwards
        parts = tmp_path / name
        toy(parts, replace(WARM, total_steps=steps))
        (parts / "demonstrations.safetensors").unlink()
        (parts / "tensorboard").rename(parts / "board")
        (parts / "tensorboard").touch()  # a run does without its files
        toy(parts, WARM, resume=name)
        assert sum("goes on without TensorBoard" in line for line in toy.lines) == 1
        toy.lines.clear()
        assert same_tensors(whole / CLONED, parts / CLONED)
        assert same_tensors(whole / LAST, parts / LAST)
        assert same_tensors(whole / EXACT, parts / EXACT)
        entries = read_progress(parts)
        assert [entry["update"] for entry in entries] == list(range(len(entries)))
        assert "eval/success" in entries[0]
        weights = [entry["update/start_kl_weight"] for entry in entries[1:]]
        assert weights[:3] == [0, 0, 0] < weights[3:6]


def test_an_interrupted_distillation_continues_after_its_last_round(toy, tmp_path, monkeypatch):
    config = Distillation(teacher="x", rounds=3, round_steps=60, cloning=Cloning(epochs=2))
    recipe = replace(WARM, warm_start=None, distill=config, total_steps=160)
    rounds, visits = [], distillation.visit

    def noted(*arguments):
        rounds.append(arguments[-1][1])
        if len(rounds) == 3:
            raise KeyboardInterrupt
        return visits(*arguments)

    monkeypatch.setattr(distillation, "visit", noted)
    with pytest.raises(KeyboardInterrupt):
        toy(tmp_path, recipe)
    assert not (tmp_path / CLONED).exists()
    refused_by_call(lambda: toy(tmp_path, recipe, seed=1), "has seed 0, not 1")
    toy(tmp_path, recipe)
    assert rounds == [0, 1, 2, 2]
    assert checkpoint.load(tmp_path / CLONED)[1]["made_from"] == {"teacher": TOY.name}
    other = replace(recipe, distill=replace(config, beta=0.5))
    refused_by_call(lambda: toy(tmp_path, other, resume=LAST), "another distill")


def test_bad_input_is_reported_in_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(distillation, "WEIGHTS", tmp_path / "nothing_ships")
    names = {name: tmp_path / name.lower() for name in ("DIR", "FULL", "DEMO", "OLD", "SMALL")}
    names["FULL"].mkdir()
    (names["FULL"] / "thesis.txt").write_text("mine")
    examples, env = random_examples([3], linear), find_recipe("close_drawer_blind").env
    write_examples(names["DEMO"], examples, [], env, ABOUT)
    write_examples(names["SMALL"], examples, [], find_recipe("pick_cloned").env, ABOUT)
    checkpoint.save(tmp_path / "old", {"network/x": torch.zeros(1)}, {"format": 99})
    cases = {
        "train pick_blnd --out DIR": "Did you mean 'pick_blind'",
        "train pick_blind --out DIR --resume": "there is no run",
        "train pick_blind --out DIR --exact": "--exact",
        "train pick_blind --out FULL": "--force does not replace it",
        "train pick_blind --out DIR --demonstrations DEMO": "does not start",
        "train pick_blind --out DIR --teacher DEMO": "has no teacher",
        "train pick_cloned --out DIR --demonstrations DEMO": "not HabPick-v1",
        "train pick_cloned --out DIR --demonstrations SMALL": "state of shape (2,), pick_cloned (",
        "train place_depth --out DIR --teacher nowhere": "no weights nowhere",
        "train pick_blind --out DIR --weights DEMO --scratch": "--scratch",
        "demonstrate pick_blind --out DIR --agent hab_eval:no": "Unknown agent",
        "demonstrate navigate_blind --out DIR": "ee and ee_base",
        "eval none.safetensors": "cannot be read",
        "eval OLD": "format 99",
        "plot DIR": "progress.jsonl",
    }

    def check(line):
        arguments = [names.get(word, word) for word in line.split()]
        refused_by_command(main, arguments, cases[line])

    check_each({line: line for line in cases}, check)
