"""Suite train: its rows, and a training run that is timed."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from hab_eval.bench.options import BenchOptions
from hab_ppo import bench_train
from hab_ppo.bench_train import SUITE, run_train, trained

from hab_tasks.errors import RunStoppedError


def test_training_is_measured_beside_its_references(monkeypatch):
    speeds = {"pick_blind": 120.0, "hab_ppo.bench_train:RECURRENT": 90.0}
    toy = SimpleNamespace(reset=lambda seed: None, close=lambda: None)
    learner = SimpleNamespace(measure=lambda: 30.0, close=lambda: None)
    for name, replacement in {
        "vector_env": lambda mode: toy,
        "stepped": lambda env, steps: 150.0,
        "trained": lambda recipe, steps: speeds[recipe],
        "Sb3Learner": lambda env, steps: learner,
        "sb3_rows": lambda: None,
        "sb3_processes": lambda: None,
    }.items():
        monkeypatch.setattr(bench_train, name, replacement)
    options, lines = BenchOptions(suite=SUITE, scene_dataset=Path("data"), repeats=3), []
    for installed in (None, True):
        found = SimpleNamespace(find_spec=lambda name, installed=installed: installed)
        monkeypatch.setattr(bench_train.importlib, "util", found)
        rows = {row.name.split("/")[-1]: row for row in run_train(options, lines.append)}
        assert rows["2_ranks"].ratio == pytest.approx(0.8)
        assert len(rows) == (3 if installed else 1)
    assert rows["2_ranks_and_sb3_rows"].ratio == pytest.approx(3)
    assert sum("sb3-contrib is not installed" in line for line in lines) == 1


def test_a_training_run_is_timed_without_its_start(monkeypatch):
    def run(command, **_):
        out = Path(command[command.index("--out") + 1])
        out.mkdir()
        lines = [json.dumps({"time/steps_per_s": speed}) for speed in (900.0, 30.0, 20.0, 40.0)]
        (out / "progress.jsonl").write_text("\n".join(lines) + "\n")
        return SimpleNamespace(returncode=0 if command[4] == "pick_blind" else 2, stderr="no idea")

    fake = SimpleNamespace(run=run, DEVNULL=None, PIPE=None)
    monkeypatch.setattr(bench_train, "subprocess", fake)
    assert trained("pick_blind", 10) == 30.0
    with pytest.raises(RunStoppedError, match="training run of the benchmark failed"):
        trained("pick_blnd", 10)


@pytest.mark.long
def test_a_short_training_run_is_timed(monkeypatch):
    monkeypatch.setattr(bench_train, "EPISODES", 2)
    assert trained("hab_ppo.bench_train:RECURRENT", 10) > 0
