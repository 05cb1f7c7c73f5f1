"""`hab-ppo navigator` and its agents in a real environment."""

import pytest
from hab_eval.cli import main as hab_eval
from hab_eval.results import read_record
from hab_ppo import NAVIGATORS
from hab_ppo.cli import main
from hab_ppo.navigation.weights import load

pytestmark = pytest.mark.slow


def test_a_run_continues_after_its_last_round(tmp_path, capsys):
    short = ["--episodes", "4", "--rows", "2", "--workers", "1", "--epochs", "1"]
    command = ["navigator", *short, "--out", str(tmp_path)]
    assert main([*command, "--rounds", "1", "--training-episodes", "2"]) == 0
    first = load(tmp_path / "navigator.safetensors")[1]["rounds"]
    command += ["--training-episodes", "3", "--rounds", "2"]  # may change in between
    assert main(command) == 0
    rounds = load(tmp_path / "navigator.safetensors")[1]["rounds"]
    # A quarter of 4 episodes, but at least one for each of two rows; then two for each.
    assert [found["episodes"] for found in rounds] == [2, 4]
    assert [found["training_episodes"] for found in rounds] == [2, 3]
    assert rounds[:1] == first
    # Lessons are taken every 12 actions of at most 125.
    assert rounds[0]["lessons"] < rounds[1]["lessons"] <= 6 * 11
    assert main([*command, "--seed", "1"]) == 2
    assert "another seed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "episodes"),
    [("navigator", "3"), *(pytest.param(n, "10", marks=pytest.mark.long) for n in NAVIGATORS)],
)
def test_the_agents_solve_most_episodes(name, episodes, tmp_path):
    arrives = ["--skill-config", "learned_stop=0"] if NAVIGATORS[name] == "never" else []
    run = ["run", "--agent", f"hab_ppo:{name}", "--env", "HabNavigate-v1", "--episodes", episodes]
    assert hab_eval([*run, *arrives, "--seed", "3", "--out", str(tmp_path / "run")]) == 0
    summary = read_record(tmp_path / "run" / "run.json").summary
    # One stop finds fewer goals than several. The episodes and the agents are deterministic.
    assert summary.success.mean >= (0.3 if NAVIGATORS[name] == "once" else 0.6)
