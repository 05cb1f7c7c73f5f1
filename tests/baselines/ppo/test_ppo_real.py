"""The commands on real environments: every recipe, exact resume, and a rank that is killed."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import pytest
import torch
from hab_eval.cli import main as hab_eval
from hab_eval.results import read_record
from hab_ppo import checkpoint
from hab_ppo.agent import spec_of
from hab_ppo.cli import main
from hab_ppo.distributed import Ranks
from hab_ppo.episodes import training_episodes
from hab_ppo.network import new_policy
from hab_ppo.observation import Observation, ObservationLayout
from hab_ppo.play import play
from hab_ppo.progress import read_progress
from hab_ppo.recipe import FAST, PAPER, EnvConfig
from hab_ppo.recipes import find_recipe, recipe_names
from hab_ppo.trainer import LAST, Trainer, TrainPlan
from hab_ppo.warm_start import make_rows
from PIL import Image
from untrained import write_weights

from hab_tasks.agent_spaces import agent_spaces
from hab_tasks.envs import ENVS
from hab_tasks.registration import SKILLS

pytestmark, long = pytest.mark.slow, pytest.mark.long

SKILL_RECIPES = [
    name
    for name in recipe_names()
    # One recipe with images is enough: they differ in nothing but the environment and the teacher.
    if find_recipe(name).env.env in SKILLS and ("_depth" not in name or name == "pick_depth")
]


def _interface(name: str) -> tuple[str, ...]:
    env = find_recipe(name).env
    return env.env, env.obs_mode, env.control_mode


def _trained_in(name: str) -> EnvConfig:
    return replace(find_recipe(name).env, num_episodes=1)


TRAINED = {_trained_in(name): name for name in SKILL_RECIPES}.values()
"""One recipe of each environment: from nothing, all of them are trained in the same way."""

PLAYED = {_interface(name): name for name in TRAINED}.values()
"""One recipe of each interface: how weights were trained makes no difference in playing them."""

SHORT = ("--rows", "4", "--rollout-steps", "10", "--episodes", "2", "--evaluation-episodes", "1")


@pytest.fixture(autouse=True, scope="module")
def _one_cache(tmp_path_factory):
    """Generated episodes go to a folder of their own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HAB_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        yield


def test_the_network_of_every_recipe_fits_its_environment():
    for name in recipe_names():
        check_network(find_recipe(name))


def check_network(recipe):
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


def test_an_agent_sees_what_the_policy_saw_in_training():
    recipe = find_recipe("close_drawer_blind")
    recipe = replace(recipe, env=replace(recipe.env, num_episodes=2))
    (episode, _) = training_episodes(recipe, 1, lambda line: None)
    single = gym.make(recipe.env.reference, num_envs=1, **recipe.env.options())
    rows = make_rows(recipe, 2, 1)
    try:
        space = agent_spaces(recipe.env.env, spec_of(recipe)).observation
        layout = ObservationLayout.of(space)
        assert ObservationLayout.of(rows.single_observation_space) == layout
        obs, _ = single.reset(options={"episode": episode})
        both, _ = rows.reset(options={"episode": [episode, episode]})
        assert torch.equal(layout.read(obs).state[0], layout.read(both).state[1])
    finally:
        single.close()
        rows.close()


@pytest.mark.parametrize("repeat", [pytest.param(1, marks=long), 4])
def test_an_agent_acts_as_the_policy_does_in_rows(repeat, tmp_path):
    """Also where actions are repeated."""
    recipe = find_recipe("navigate_blind")
    recipe = replace(recipe, draws_actions=False, env=replace(recipe.env, action_repeat=repeat))
    weights, out = tmp_path / "weights.safetensors", tmp_path / "run"
    write_weights(recipe, weights)
    rows = play(weights, split="val", episodes=3, seed=0, rows=3, workers=1)
    agent = ["--agent", f"hab_ppo:{recipe.name}", "--option", f"weights={weights}"]
    run = ["run", *agent, "--env", recipe.env.env, "--episodes", "3", "--seed", "0"]
    assert hab_eval([*run, "--out", str(out)]) == 0
    summary = read_record(out / "run.json").summary
    assert summary.mean_steps / repeat == pytest.approx(rows.mean_steps)  # 500 without success
    assert summary.mean_return.mean == pytest.approx(rows.mean_return, abs=1e-4)


@pytest.mark.parametrize(
    "name",
    [n if n in ("pick_blind", "pick_depth") else pytest.param(n, marks=long) for n in TRAINED],
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


@long
def test_a_run_in_a_task_reports_its_stages(tmp_path):
    recipe = find_recipe("monolithic_set_table")
    recipe = replace(
        recipe,
        env=replace(recipe.env, obs_mode="state_dict", num_episodes=2),
        preset=replace(FAST, rows=2, rollout_steps=4600, ppo=PAPER.ppo),
        total_steps=9_000,
        evaluation_episodes=1,
    )
    Trainer(TrainPlan(recipe=recipe, out=tmp_path), Ranks(), lambda line: None).run()
    (entry,) = read_progress(tmp_path)
    names = [name.rpartition("/")[2] for name in entry if name.startswith("train/stage/")]
    assert names == list(ENVS[recipe.env.env].env.task.stages)
    for kind in ("train", "eval"):
        assert all(0.0 <= entry[f"{kind}/stage/{name}"] <= 1.0 for name in names)
    assert main(["plot", str(tmp_path)]) == 0
    with Image.open(tmp_path / "curves.png") as picture:
        assert picture.width == 4 * 480  # a panel more than for a skill


def test_a_resumed_run_equals_one_that_was_never_interrupted(tmp_path):
    recipe = find_recipe("pick_blind")
    recipe = replace(
        recipe,
        env=replace(recipe.env, num_episodes=4),
        preset=replace(
            recipe.preset,
            # The run is cut short below.
            ppo=replace(recipe.preset.ppo, final_log_std=None, decays=False),
            rows=4,
            rollout_steps=30,
        ),
        total_steps=600,
        evaluation_steps=200,
        evaluation_episodes=2,
    )

    def train(out, **options):
        plan = TrainPlan(recipe=options.pop("recipe", recipe), out=out, **options)
        return Trainer(plan, Ranks(), lambda line: None).run()

    train(tmp_path / "whole")
    train(tmp_path / "parts", recipe=replace(recipe, total_steps=400))
    train(tmp_path / "parts", resume="exact.safetensors")
    one, other = (checkpoint.load(tmp_path / run / LAST)[0] for run in ("whole", "parts"))
    assert all(torch.equal(one[name], other[name]) for name in one)
    assert read_progress(tmp_path / "whole")[-1]["steps"] >= 600


def ranks_of(launcher: int) -> list[int]:
    """Process ids of the ranks that a launcher started."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            stat = (process / "stat").read_text().rpartition(")")[2].split()
            words = (process / "cmdline").read_bytes()
        except OSError:
            continue
        if int(stat[1]) == launcher and b"hab_ppo" in words:
            found.append(int(process.name))
    return found


def test_a_run_goes_on_after_a_rank_was_killed(tmp_path):
    out = tmp_path / "run"
    command = [sys.executable, "-m", "hab_ppo", "train", "pick_blind", "--ranks", "2"]
    command += ["--out", str(out), "--steps", "800", "--evaluation-steps", "100000", *SHORT]
    with (tmp_path / "log").open("w") as log:
        run = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)
        try:
            wait_for(lambda: len(read_progress(out)) >= 2, run)
            os.kill(ranks_of(run.pid)[-1], signal.SIGKILL)
            status = run.wait(timeout=240)
        finally:
            run.kill()
    assert status == 0, (tmp_path / "log").read_text()
    numbers = [entry["update"] for entry in read_progress(out)]
    assert numbers == list(range(1, len(numbers) + 1))
    assert read_progress(out)[-1]["steps"] >= 800


def wait_for(condition, run):
    ends = time.monotonic() + 240
    while not condition():
        assert run.poll() is None, "the run ended by itself"
        assert time.monotonic() < ends
        time.sleep(0.1)


def test_demonstrations_of_a_planner_start_a_run(tmp_path, capsys):
    file, out = tmp_path / "demonstrations.safetensors", tmp_path / "run"
    demonstrate = ["demonstrate", "close_drawer_blind", "--count", "2", "--episodes", "4"]
    assert main([*demonstrate, "--workers", "2", "--out", str(file)]) == 0
    assert "2 demonstrations: the agent solved" in capsys.readouterr().out
    again = tmp_path / "again.safetensors"
    assert main([*demonstrate, "--workers", "1", "--out", str(again)]) == 0
    one, other = checkpoint.load(file)[0], checkpoint.load(again)[0]
    assert set(one) == set(other)
    for name, tensor in one.items():  # what a stretch does not have is NaN
        torch.testing.assert_close(tensor, other[name], rtol=0, atol=0, equal_nan=True, msg=name)
    train = ["train", "close_drawer_blind", "--demonstrations", str(file), "--out", str(out)]
    assert main([*train, "--steps", "40", *SHORT]) == 0
    assert "PPO starts from a policy with success" in capsys.readouterr().out
    assert checkpoint.load(out / "cloned.safetensors")[1]["made_from"]["counts"]["solved"] >= 2


def test_a_state_policy_teaches_a_depth_policy(tmp_path):
    teacher, out = tmp_path / "teacher", tmp_path / "student"
    assert (
        main(["train", "place_blind", "--scratch", "--out", str(teacher), "--steps", "40", *SHORT])
        == 0
    )
    recipe = find_recipe("place_depth")
    distill = replace(recipe.distill, rounds=1, round_steps=20)
    short = replace(recipe, preset=replace(recipe.preset, rows=2), distill=distill)
    plan = TrainPlan(
        recipe=replace(
            short,
            env=replace(recipe.env, num_episodes=2),
            total_steps=20,
            evaluation_episodes=1,
        ),
        out=out,
        teacher=teacher,
    )
    out.mkdir()
    lines = []
    Trainer(plan, Ranks(), lines.append).run()
    assert any("distillation, round 1 of 1" in line for line in lines)
    assert (out / "cloned.safetensors").exists()
