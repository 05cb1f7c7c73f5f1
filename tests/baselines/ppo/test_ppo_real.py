"""The commands on real environments: every recipe, exact resume, and a rank that is killed."""

import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import psutil
import pytest
import torch
from hab_eval.cli import main as hab_eval
from hab_eval.records.results import read_record
from hab_navigator.network import load
from hab_ppo import checkpoint
from hab_ppo.agent import spec_of
from hab_ppo.cli import main
from hab_ppo.distributed import Ranks
from hab_ppo.extensions import extensions
from hab_ppo.network import new_policy
from hab_ppo.observation import Observation, ObservationLayout
from hab_ppo.play import play
from hab_ppo.progress import read_progress
from hab_ppo.recipe import PAPER
from hab_ppo.recipes import find_recipe, recipe_names
from hab_ppo.trainer import TrainPlan, train_rank
from sockets import check_loopback
from untrained import write_weights

from hab_tasks.agent_spaces import agent_spaces
from hab_tasks.registration import SKILLS

pytestmark, long = pytest.mark.slow, pytest.mark.long

TRAINED = {
    repr(replace(env, num_episodes=1)): name
    for name, env in ((name, find_recipe(name).env) for name in recipe_names())
    if env.env in SKILLS and env.robot is None and env.scene_dataset == "apartment"
    # One recipe with images is enough: they differ in nothing but the environment and the teacher.
    if "_depth" not in name or name == "pick_depth"
}
"""One recipe of each environment: from nothing, all of them are trained in the same way."""

PLAYED = {
    (env.env, env.obs_mode, env.control_mode): name
    for name, env in ((name, find_recipe(name).env) for name in TRAINED.values())
}.values()
"""One recipe of each interface: how weights were trained makes no difference in playing them."""

SHORT = ("--rows", "4", "--rollout-steps", "10", "--episodes", "2", "--evaluation-episodes", "1")


def train(recipe, out, **options):
    out.mkdir(exist_ok=True)
    lines = []
    train_rank(TrainPlan(recipe=recipe, out=out, **options), Ranks(), lines.append)
    return lines


def test_the_network_of_every_recipe_fits_its_environment():
    for recipe in map(find_recipe, recipe_names()):
        spaces = agent_spaces(recipe.env.env, spec_of(recipe))
        for preset in (recipe.preset, PAPER):
            layout = ObservationLayout.of(spaces.observation, preset.network.image_block_px)
            assert (layout.image_shape is None) == (recipe.env.obs_mode == "state_dict")
            policy = new_policy(layout, spaces.action, preset.network, seed=0)
            images = layout.image_shape and torch.rand(3, *layout.image_shape)
            obs = Observation(torch.zeros(3, layout.state_size), images)
            acted = policy.choose(obs, policy.no_memory(3), torch.ones(3, dtype=torch.bool))
            assert spaces.action.contains(policy.head.to_env(acted.actions)[0])
            assert policy.lstm is not None or preset is not PAPER


def test_an_agent_acts_as_the_policy_does_in_rows_where_actions_are_repeated(tmp_path):
    recipe = find_recipe("navigate_blind")
    recipe = replace(recipe, draws_actions=False, env=replace(recipe.env, action_repeat=4))
    weights, out = tmp_path / "weights.safetensors", tmp_path / "run"
    write_weights(recipe, weights)
    played = play(weights, split="val", episodes=3, seed=0, rows=3, workers=1)
    agent = ["--agent", f"hab_ppo:{recipe.name}", "--option", f"weights={weights}"]
    run = ["run", *agent, "--env", recipe.env.env, "--episodes", "3", "--seed", "0"]
    assert hab_eval([*run, "--out", str(out)]) == 0
    summary = read_record(out / "run.json").summary
    steps, total = np.mean([(one.steps, one.episode_return) for one in played], axis=0)
    assert summary.mean_steps / 4 == pytest.approx(steps)  # 500 without success
    assert summary.mean_return.mean == pytest.approx(total, abs=1e-4)


@pytest.mark.parametrize(
    "name",
    [
        n if n in ("pick_blind", "pick_depth") else pytest.param(n, marks=long)
        for n in TRAINED.values()
    ],
)
def test_a_recipe_is_trained_and_its_weights_play(name, tmp_path, capsys):
    out, env = tmp_path / "run", find_recipe(name).env.env
    assert main(["train", name, "--out", str(out), "--steps", "40", "--scratch", *SHORT]) == 0
    assert "best.safetensors" in capsys.readouterr().out
    if name not in PLAYED:
        return
    assert main(["eval", str(out), "--episodes", "2", "--workers", "1"]) == 0
    assert "95 % interval" in capsys.readouterr().out
    agent = ["--agent", f"hab_ppo:{name}", "--option", f"weights={out}"]
    run = ["run", *agent, "--episodes", "2", "--workers", "1"]
    assert hab_eval([*run, "--env", env, "--out", str(tmp_path / "eval")]) == 0
    assert (tmp_path / "eval" / "run.json").exists()
    other = "HabPlace-v1" if env == "HabPick-v1" else "HabPick-v1"
    assert hab_eval([*run, "--env", other, "--out", str(tmp_path / "other")]) == 2
    assert f"was trained in {env}, not {other}" in capsys.readouterr().err


def test_a_policy_plays_with_its_own_robot_only(tmp_path, capsys):
    run = ["run", "--agent", "hab_ppo:pick_panda", "--env", "HabPick-v1", "--split", "val"]
    run += ["--episodes", "4", "--workers", "1", "--out", str(tmp_path / "run")]
    assert hab_eval(run) == 2
    assert "trained with the robot hab_panda_mobile, not hab_fetch" in capsys.readouterr().err
    assert hab_eval([*run, "--env-option", "robot=panda_mobile"]) == 0
    episodes = read_record(tmp_path / "run" / "run.json").episodes
    assert sum(one.success for one in episodes) >= 2  # 88 % of 50 in validation


def test_a_run_goes_on_after_a_rank_was_killed(tmp_path):
    out = tmp_path / "run"
    command = [sys.executable, "-m", "hab_ppo", "train", "pick_blind", "--ranks", "2"]
    command += ["--out", str(out), "--steps", "800", "--evaluation-steps", "100000", *SHORT]
    with (tmp_path / "log").open("w") as log:
        run = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)
        try:
            while len(read_progress(out)) < 2:
                assert run.poll() is None, "the run ended by itself"
                time.sleep(0.1)
            launcher = psutil.Process(run.pid)
            check_loopback(launcher)
            ranks = [c for c in launcher.children() if "hab_ppo" in c.cmdline()]
            ranks[-1].kill()
            status = run.wait(timeout=240)
        finally:
            run.kill()
    assert status == 0, (tmp_path / "log").read_text()
    numbers = [entry["update"] for entry in read_progress(out)]
    assert numbers == list(range(1, len(numbers) + 1))
    assert read_progress(out)[-1]["steps"] >= 800


def test_demonstrations_of_a_planner_start_a_run(tmp_path, capsys):
    file, out = tmp_path / "demonstrations.safetensors", tmp_path / "run"
    demonstrate = ["demonstrate", "close_drawer_blind", "--count", "2", "--episodes", "4"]
    assert main([*demonstrate, "--workers", "2", "--out", str(file)]) == 0
    assert "2 demonstrations: the agent solved" in capsys.readouterr().out
    again = tmp_path / "again.safetensors"
    assert main([*demonstrate, "--workers", "1", "--out", str(again)]) == 0
    one, other = checkpoint.load(file)[0], checkpoint.load(again)[0]
    # What a stretch does not have is NaN.
    torch.testing.assert_close(one, other, rtol=0, atol=0, equal_nan=True)
    train = ["train", "close_drawer_blind", "--demonstrations", str(file), "--out", str(out)]
    assert main([*train, "--steps", "40", *SHORT]) == 0
    assert "PPO starts from a policy with success" in capsys.readouterr().out
    assert checkpoint.load(out / "cloned.safetensors")[1]["made_from"]["counts"]["solved"] >= 2


def test_learning_to_navigate_continues_after_its_last_round(tmp_path):
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


@pytest.mark.parametrize(
    ("name", "episodes"),
    [("navigator", "3"), *(pytest.param(n, "10", marks=long) for n in extensions("agents"))],
)
def test_navigators_solve_most_episodes(name, episodes, tmp_path):
    arrives = ["--skill-config", "learned_stop=0"] if name.endswith("without_stop") else []
    run = ["run", "--agent", f"hab_ppo:{name}", "--env", "HabNavigate-v1", "--episodes", episodes]
    assert hab_eval([*run, *arrives, "--seed", "3", "--out", str(tmp_path / "run")]) == 0
    summary = read_record(tmp_path / "run" / "run.json").summary
    # One stop finds fewer goals than several. The episodes and the agents are deterministic.
    assert summary.success.mean >= (0.3 if name.endswith("once") else 0.6)
