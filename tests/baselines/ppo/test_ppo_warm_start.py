"""Fine-tuning and distillation in the toy environment."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
import toy_examples
from hab_ppo import checkpoint, distillation, warm_start
from hab_ppo.actions import action_head
from hab_ppo.agent import LoadedPolicy
from hab_ppo.collect import Collector
from hab_ppo.demonstration_file import write_examples
from hab_ppo.distillation import distill, visit
from hab_ppo.distributed import Ranks
from hab_ppo.errors import RecipeError
from hab_ppo.evaluation import evaluate
from hab_ppo.examples import Examples
from hab_ppo.fine_tuning import Guide, Stage
from hab_ppo.network import Chosen, new_policy
from hab_ppo.observation import ObservationLayout
from hab_ppo.plan import BEST, CLONED, EXACT, LAST, TrainPlan
from hab_ppo.ppo import PPO
from hab_ppo.progress import read_progress
from hab_ppo.recipe import (
    FAST,
    Cloning,
    Distillation,
    EnvConfig,
    FineTuning,
    NetworkConfig,
    WarmStart,
)
from hab_ppo.teachers import PolicyTeacher, check_expert, classroom
from hab_ppo.trainer import Trainer
from toy_examples import replace_simulator, same_tensors
from toy_vector import ToyVector, goals

SPACE = ToyVector(1).single_action_space
LAYOUT = ObservationLayout.of(ToyVector(1).single_observation_space)
PLAIN = NetworkConfig(head_layers=(32,), log_std=-1.2)
LSTM = NetworkConfig(lstm_size=16, head_layers=(), log_std=-1.2)
QUIET = [].append


def test_the_stages_of_fine_tuning():
    config = FineTuning(critic_updates=2, kl_weight=0.8, kl_steps=1000)
    guide = Guide(new_policy(LAYOUT, SPACE, PLAIN, seed=0), config)
    assert guide.stage(1, 900) == Stage(critic_only=True)
    assert guide.stage(2, 250).kl_weight == pytest.approx(0.6)
    assert guide.stage(9, 2000) == Stage()


def learner_of(network):
    policy = new_policy(LAYOUT, SPACE, network, seed=1)
    learner = PPO(policy, FAST.ppo, Ranks(), Guide(policy, FineTuning()))
    collector = Collector(ToyVector(8), policy, Ranks(), 24)
    collector.reset(list(range(8)))
    return learner, collector


@pytest.mark.parametrize("network", [PLAIN, LSTM], ids=["plain", "lstm"])
def test_the_critic_warms_up_alone(network):
    learner, collector = learner_of(network)
    before = {name: value.clone() for name, value in learner.policy.state_dict().items()}
    generator = torch.Generator().manual_seed(0)
    rollout, _ = collector.collect(0, generator)
    metrics = learner.update(rollout, generator, 0.0, Stage(critic_only=True))
    for name, value in learner.policy.state_dict().items():
        assert torch.equal(value, before[name]) != name.startswith("critic."), name
    assert metrics["start_kl"] == pytest.approx(0, abs=1e-6)


def test_the_kl_term_keeps_the_policy_near_its_start():
    found = {}
    for weight in (0.0, 100.0):
        learner, collector = learner_of(PLAIN)
        for update in range(6):
            generator = torch.Generator().manual_seed(update)
            rollout, _ = collector.collect(update, generator)
            metrics = learner.update(rollout, generator, 0.0, Stage(kl_weight=weight))
        found[weight] = metrics["start_kl"]
    assert 0 <= found[100.0] < 0.1 * found[0.0]


# Distillation -----------------------------------------------------------------------------------


class Walker:
    """A teacher that walks to the goal as fast as it can."""

    layout = LAYOUT
    head = action_head(SPACE, 0.0)

    def no_memory(self, rows):
        return torch.zeros(2, rows, 0)

    def choose(self, obs, memory, starts, noise=None):
        gap = obs.state[:, 1:] - obs.state[:, :1]
        return Chosen((gap / 0.2).clamp(-1, 1), memory)


class Stubborn(Walker):
    """A student that always walks to the right."""

    state_normalizer = SimpleNamespace(mean=torch.zeros(1))

    def choose(self, obs, memory, starts, noise=None):
        return Chosen(torch.ones(len(obs.state), 1), memory)


def test_the_states_that_the_student_visits_get_the_labels_of_the_teacher():
    visits = visit(Stubborn(), PolicyTeacher(Walker(), 4), ToyVector(4), 60, 0.0, [0])
    assert 60 <= sum(len(part.state) for part in visits.parts) < 64
    for part in visits.parts:
        # 0.2 further right in each step, whatever the goal.
        assert np.allclose(part.state[:, 0], 0.2 * np.arange(len(part.state)), atol=1e-5)
        gap = part.state[:, 1:] - part.state[:, :1]
        torch.testing.assert_close(part.actions, (gap / 0.2).clamp(-1, 1))
    assert visits.episodes > visits.successes
    led = visit(Stubborn(), PolicyTeacher(Walker(), 4), ToyVector(4), 60, 1.0, [0])
    assert led.episodes == led.successes > 0


@pytest.mark.parametrize("images", [False, True], ids=["blind", "images"])
def test_a_student_is_distilled(images):
    env = ToyVector(8, images=images)
    layout = ObservationLayout.of(env.single_observation_space)
    student = new_policy(layout, SPACE, replace(PLAIN, image_features=8), seed=0)
    cloning = Cloning(epochs=4 if images else 30, batch_steps=64)
    config = Distillation(teacher="", rounds=3, round_steps=300, cloning=cloning)
    distill(student, PolicyTeacher(Walker(), env.num_envs), env, config, 0, Ranks(), QUIET)
    env.reset(seed=list(range(8)))
    scores = evaluate(env, student, goals(20))
    assert sum(score.success for score in scores) >= 16


def test_an_expert_is_a_method_of_the_environment():
    check_expert("shortest_path_action", EnvConfig(env="HabNavigate-v1", control_mode="base"))
    with pytest.raises(RecipeError, match="HabPick-v1 has no expert shortest_path_action"):
        check_expert("shortest_path_action", EnvConfig(env="HabPick-v1", control_mode="ee"))


def test_a_teacher_sees_a_handle_that_the_student_has_to_find():
    blind = EnvConfig(env="HabOpenDrawer-v1", control_mode="ee", handle_position=True)
    depth = replace(blind, obs_mode="depth", handle_position=False)
    teacher = LoadedPolicy(Walker(), replace(TOY, env=blind))
    assert classroom(depth, teacher) == replace(depth, handle_position=True)
    with pytest.raises(RecipeError, match="observes depth, the student state_dict"):
        classroom(blind, LoadedPolicy(Walker(), replace(TOY, env=depth)))


# Runs -------------------------------------------------------------------------------------------

TOY = replace(
    toy_examples.TOY,
    total_steps=960,
    evaluation_steps=320,
    warm_start=WarmStart(
        cloning=Cloning(epochs=3), rounds=0, tuning=FineTuning(critic_updates=3, kl_steps=1000)
    ),
)


@pytest.fixture
def train(monkeypatch):
    """Runs in the toy, with demonstrations of the walker."""

    def demonstrations(path, plan, write_line):
        assert plan.agent == "hab_spa:spa_priv"
        teacher = PolicyTeacher(Walker(), 4)
        visits = visit(Stubborn(), teacher, ToyVector(4), 200, 1.0, [plan.seed])
        about = {"agent": "", "seed": 0, "counts": {}}
        write_examples(path, Examples.joined(visits.parts), [], plan.recipe.env, about)

    monkeypatch.setattr(warm_start, "write_demonstrations", demonstrations)
    monkeypatch.setattr(warm_start, "load_teacher", lambda *_: LoadedPolicy(Walker(), TOY))
    monkeypatch.setattr(warm_start, "known_weights", lambda name, option: Path(name))
    replace_simulator(monkeypatch)

    def run(out, recipe=TOY, **options):
        out.mkdir(exist_ok=True)
        return Trainer(TrainPlan(recipe=recipe, out=out, **options), Ranks(), QUIET).run()

    return run


def test_a_run_starts_from_given_weights(train, tmp_path):
    first, second, third = tmp_path / "first", tmp_path / "second", tmp_path / "third"
    best = train(first).best_success
    plain = replace(TOY, warm_start=None, total_steps=320)
    train(second, plain, weights=first / BEST)
    start, *updates = read_progress(second)
    assert start["eval/success"] == best
    assert not any("update/start_kl" in entry for entry in updates)
    assert not (second / CLONED).exists()
    given, learned = checkpoint.load(first / BEST)[0], checkpoint.load(second / LAST)[0]
    assert not all(torch.equal(learned[name], value) for name, value in given.items())
    count = "network/state_normalizer.count"
    assert learned[count] >= given[count] + 320
    # In a recipe with a warm start, they take the place of the clone.
    train(third, replace(TOY, total_steps=320), weights=first / BEST)
    tensors, about = checkpoint.load(third / CLONED)
    assert about["made_from"] == {"weights": BEST}
    assert all(torch.equal(value, given[name]) for name, value in tensors.items())
    assert "update/start_kl" in read_progress(third)[1]


def test_a_resumed_run_equals_one_that_was_never_interrupted(train, tmp_path):
    whole = tmp_path / "whole"
    train(whole)
    for name, steps in ((LAST, 320), (EXACT, 640)):  # in the warm-up, and afterwards
        parts = tmp_path / name
        train(parts, replace(TOY, total_steps=steps))
        (parts / "demonstrations.safetensors").unlink()
        train(parts, resume=name)
        assert same_tensors(whole / CLONED, parts / CLONED)
        assert same_tensors(whole / LAST, parts / LAST)
        assert same_tensors(whole / EXACT, parts / EXACT)
        entries = read_progress(parts)
        assert [entry["update"] for entry in entries] == list(range(len(entries)))
        assert "eval/success" in entries[0]
        weights = [entry["update/start_kl_weight"] for entry in entries[1:]]
        assert weights[:3] == [0, 0, 0] < weights[3:6]


def test_an_interrupted_distillation_continues_after_its_last_round(train, tmp_path, monkeypatch):
    config = Distillation(teacher="x", rounds=3, round_steps=60, cloning=Cloning(epochs=2))
    recipe = replace(TOY, warm_start=None, distill=config, total_steps=160)
    rounds, visits = [], distillation.visit

    def noted(*arguments):
        rounds.append(arguments[-1][1])
        if len(rounds) == 3:
            raise KeyboardInterrupt
        return visits(*arguments)

    monkeypatch.setattr(distillation, "visit", noted)
    with pytest.raises(KeyboardInterrupt):
        train(tmp_path, recipe)
    assert rounds == [0, 1, 2]
    assert not (tmp_path / CLONED).exists()
    with pytest.raises(RecipeError, match="has seed 0, not 1"):
        train(tmp_path, recipe, seed=1)
    train(tmp_path, recipe)
    assert rounds == [0, 1, 2, 2]
    assert checkpoint.load(tmp_path / CLONED)[1]["made_from"] == {"teacher": TOY.name}
    other = replace(recipe, distill=replace(config, beta=0.5))
    with pytest.raises(RecipeError, match="another distill"):
        train(tmp_path, other, resume=LAST)
