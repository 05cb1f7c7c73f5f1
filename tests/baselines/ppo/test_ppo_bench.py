"""Suite train: its rows, and a training run that is timed."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from hab_eval.bench.options import BenchOptions
from hab_ppo import bench_train
from hab_ppo.bench_train import RECURRENT, SUITE, run_train, trained

from hab_tasks.errors import RunStoppedError


@pytest.mark.parametrize("installed", [False, True], ids=["alone", "with sb3-contrib"])
def test_training_is_measured_beside_its_references(installed, monkeypatch):
    toy = SimpleNamespace(reset=lambda seed: None, close=lambda: None)
    learner = SimpleNamespace(measure=lambda: 30.0, close=lambda: None)
    speeds = {"pick_blind": 120.0, "hab_ppo.bench_train:RECURRENT": 90.0}
    monkeypatch.setattr(bench_train, "vector_env", lambda mode: toy)
    monkeypatch.setattr(bench_train, "stepped", lambda env, steps: 150.0)
    monkeypatch.setattr(bench_train, "trained", lambda recipe, steps: speeds[recipe])
    monkeypatch.setattr(bench_train, "Sb3Learner", lambda env, steps: learner)
    for name in ("sb3_rows", "sb3_processes"):
        monkeypatch.setattr(bench_train, name, lambda: None)
    found = SimpleNamespace(find_spec=lambda name: installed or None)
    monkeypatch.setattr(bench_train.importlib, "util", found)
    lines = []
    options = BenchOptions(suite=SUITE, scene_dataset=Path("data"), repeats=3)
    rows = {row.name.split("/")[-1]: row for row in run_train(options, lines.append)}
    assert rows["2_ranks"].ratio == pytest.approx(0.8)
    assert rows["2_ranks"].n == 3
    if installed:
        assert rows["2_ranks_and_sb3_rows"].ratio == pytest.approx(3)
        assert rows["2_ranks_and_sb3_processes"].reference_value == 30
    else:
        assert list(rows) == ["2_ranks"]
        assert "sb3-contrib is not installed" in lines[0]


def test_the_recurrent_recipe_has_an_lstm_and_the_same_heads():
    fast = bench_train.PICK_BLIND.preset.network
    assert RECURRENT.preset.network.lstm_size > 0 == fast.lstm_size
    assert RECURRENT.preset.network.head_layers == fast.head_layers


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
def test_a_short_training_run_is_timed(monkeypatch, tmp_path):
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(bench_train, "EPISODES", 2)
    assert trained("hab_ppo.bench_train:RECURRENT", 10) > 0
