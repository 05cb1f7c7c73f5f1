"""A training run: collect, update, evaluate, keep.

After each evaluation all rows start anew in simulations built anew, with seeds drawn from the
run's seed and the update's number, and an exact checkpoint is kept. A run that continues from it
therefore equals one that was never interrupted (bit for bit on one rank). The checkpoint of the
last update is kept too, so that a killed run loses nothing but its current rollout.
"""

from __future__ import annotations

import json
import time
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from hab_eval.records.provenance import device, git_commit

from hab_ppo import checkpoint
from hab_ppo.actions import ActionNoise
from hab_ppo.checkpoint import Position, load
from hab_ppo.collect import Collector
from hab_ppo.distributed import Ranks, is_prepared, is_rank, launch
from hab_ppo.episodes import EpisodeSupply, check_episodes
from hab_ppo.network import new_policy
from hab_ppo.observation import ObservationLayout
from hab_ppo.plan import BEST, EXACT, LAST, RECIPE, TrainPlan, check_same
from hab_ppo.ppo import PPO, Stage
from hab_ppo.progress import PARTS, Progress, Recent, WriteLine
from hab_ppo.recipe import Recipe
from hab_ppo.rows import binary_entries, evaluate, stage_names
from hab_ppo.train_command import TrainCommand
from hab_ppo.warm_start import check_start, make_rows, start_policy
from hab_tasks.io.console import EXIT_INTERRUPTED, tell
from hab_tasks.io.files import written_aside
from hab_tasks.io.threads import use_one_thread
from hab_tasks.typed_values import to_json

COLLAPSE_SHARE = 0.5
"""A run whose success falls below this share of its best is reported."""


def train_rank(plan: TrainPlan, ranks: Ranks, write_line: WriteLine) -> Position:
    """Builds the parts of a run, as one of its ranks, and trains; returns where the run ended."""
    use_one_thread()
    recipe, preset = plan.recipe, plan.recipe.preset
    write_line = write_line if ranks.is_first else lambda line: None
    with EpisodeSupply(recipe, ranks, write_line) as supply:
        env = make_rows(recipe, preset.rows, 1)
        layout = ObservationLayout.of(env.single_observation_space, preset.network.image_block_px)
        space = env.single_action_space
        policy = new_policy(layout, space, preset.network, plan.seed, binary_entries(recipe))
        policy = policy.to(ranks.device)
        guide = start_policy(plan, ranks, policy, supply, write_line)
        learner = PPO(policy, preset.ppo, ranks, guide)
        position = _restored(plan, ranks, learner) if plan.resume else Position()
        return Trainer(plan, ranks, env, learner, supply, position, write_line).run()


def _restored(plan: TrainPlan, ranks: Ranks, learner: PPO) -> Position:
    """Sets a learner to a checkpoint, read by the first rank; returns its position."""
    path = plan.out / str(plan.resume)
    data = ranks.from_first(checkpoint.read(path) if ranks.is_first else b"")
    tensors, about = checkpoint.parse(data, path)
    check_same(plan, about)
    checkpoint.load_learner(learner, tensors, path)
    return Position(**about["position"])


class Trainer:
    """One rank of a run, from a position to the end."""

    def __init__(
        self,
        plan: TrainPlan,
        ranks: Ranks,
        env: Any,
        learner: PPO,
        supply: EpisodeSupply,
        position: Position,
        write_line: WriteLine,
    ) -> None:
        """Takes the parts of a run: its rows, its learner and its episodes."""
        self._plan, self._recipe, self._ranks = plan, plan.recipe, ranks
        self._env, self._learner, self._supply = env, learner, supply
        self._position, self._write_line = position, write_line
        preset, self._stages = plan.recipe.preset, stage_names(plan.recipe.env)
        self._collector = Collector(
            env,
            learner.policy,
            ranks,
            preset.rollout_steps,
            preset.ppo.noise_correlation,
            self._stages,
        )
        self._recent = Recent(self._stages)
        self._origin = {"command": plan.command, "device": device(), "git": git_commit()}
        self._began_s = time.perf_counter() - position.seconds

    def run(self) -> Position:
        """Trains to the end; returns where the run ended."""
        progress = None
        try:
            if self._ranks.is_first:
                self._write_recipe()
                progress = Progress(
                    self._plan.out,
                    self._write_line,
                    self._recipe.total_steps,
                    self._position.update,
                )
            # Random weights solve nothing, so only a warm start is evaluated before
            # its first update.
            started = self._learner.guide is not None or self._plan.weights is not None
            if started and self._position.update == 0:
                self._evaluate_start(progress)
            self._start_rows()
            while self._position.steps < self._recipe.total_steps:
                metrics = self._update()
                metrics |= self._evaluate_if_due(progress)
                if progress is not None:
                    self._save(LAST)
                    at = self._position
                    progress.add(at.update, at.steps, at.seconds, metrics)
        finally:
            if progress is not None:
                progress.close()
            self._env.close()
        return self._position

    def _update(self) -> dict[str, float]:
        """Collects a rollout and learns from it; returns the metrics."""
        at, clock = self._position, self._collector.clock
        before, began = dict(clock.seconds), time.perf_counter()
        noise = self._generator(1, self._ranks.device)
        share = at.steps / self._recipe.total_steps
        # Before the rollout, so that it is collected and judged with the same spread.
        log_std = self._recipe.log_std(share)
        if log_std is not None:
            self._learner.policy.head.explore(log_std)
        with clock("env"):
            self._grow()
        rollout, sums = self._collector.collect(at.update, noise)
        with clock("update"):
            stage = self._stage()
            metrics = self._learner.update(rollout, self._generator(2), share, stage)
        metrics = {f"update/{name}": value for name, value in metrics.items()}
        # Steps that only reset a row are no experience, and preempted ranks have fewer.
        steps = rollout.valid.sum().double().cpu()[None]
        steps, *episodes = self._ranks.sum(torch.cat((steps, sums))).tolist()
        self._recent.add(episodes)
        seconds = time.perf_counter() - began
        for part in PARTS:
            spent = clock.seconds.get(part, 0.0) - before.get(part, 0.0)
            metrics[f"time/{part}"] = spent / seconds
        metrics["time/steps_per_s"] = steps / seconds
        self._position = replace(
            at, update=at.update + 1, steps=at.steps + int(steps), seconds=self._seconds()
        )
        return metrics | self._recent.metrics

    def _stage(self) -> Stage:
        """Returns how the next update learns."""
        guide, at = self._learner.guide, self._position
        return Stage() if guide is None else guide.stage(at.update, at.steps)

    def _seconds(self) -> float:
        """Returns the time since the run began, over all its starts, without starting up [s]."""
        return time.perf_counter() - self._began_s

    # Evaluation ------------------------------------------------------------------------------

    def _evaluate_if_due(self, progress: Progress | None) -> dict[str, float]:
        """Evaluates at the end and every `evaluation_steps`, then starts all rows anew."""
        at, recipe = self._position, self._recipe
        # By steps, not by updates, as preemption makes the length of a rollout vary.
        number = at.steps // recipe.evaluation_steps
        if number > at.evaluated or at.steps >= recipe.total_steps:
            metrics = self._evaluated()
            success = metrics["eval/success"]
            self._position = replace(at, evaluated=number, seconds=self._seconds(), success=success)
            self._keep_best(success, progress)
            if progress is not None:
                self._save(EXACT)
            self._start_rows()
            return metrics | self._best()
        return {}

    def _evaluate_start(self, progress: Progress | None) -> None:
        """Evaluates the policy from which PPO starts."""
        metrics = self._evaluated()
        success = metrics["eval/success"]
        self._position = replace(self._position, seconds=self._seconds(), success=success)
        self._keep_best(success, progress)
        if progress is not None:
            progress.begin(self._position.seconds, metrics | self._best())

    def _best(self) -> dict[str, float]:
        best = self._position.best_success
        return {} if best is None else {"eval/best": best}

    def _evaluated(self) -> dict[str, float]:
        """Returns the rates of success and stages and the mean return over all ranks' episodes."""
        ranks, names = self._ranks, ["eval/success", "eval/return"]
        names += [f"eval/stage/{name}" for name in self._stages]
        mine = self._supply.evaluation[ranks.rank :: ranks.size]
        policy = self._learner.policy
        noise = None
        if self._recipe.draws_actions:
            noise = ActionNoise(self._generator(3, ranks.device))
        sums = torch.zeros(1 + len(names), dtype=torch.float64)
        for one in evaluate(self._env, policy, mine, noise):
            stages = (one.stages[name] for name in self._stages)
            row = (1.0, one.success, one.episode_return, *stages)
            sums += torch.tensor(row, dtype=torch.float64)
        count, *totals = ranks.sum(sums).tolist()
        return {name: total / count for name, total in zip(names, totals, strict=True)}

    def _keep_best(self, success: float, progress: Progress | None) -> None:
        """Keeps the weights if none were better, and reports a collapse."""
        at = self._position
        # Of equal ones the later, which has learnt for longer.
        if at.best_success is None or success >= at.best_success:
            self._position = replace(at, best_success=success, best_steps=at.steps)
            if progress is not None:
                tensors = checkpoint.network_tensors(self._learner.policy)
                checkpoint.save(self._plan.out / BEST, tensors, self._about())
        elif success < COLLAPSE_SHARE * at.best_success and progress is not None:
            progress.say(
                f"Success fell from {at.best_success:.0%} (at {at.best_steps:,} steps) to "
                f"{success:.0%}; the best weights are kept in {BEST}."
            )

    # Rows and checkpoints --------------------------------------------------------------------

    def _start_rows(self) -> None:
        """Starts all rows anew; what follows depends on recipe, seed and update alone."""
        self._grow()
        drawn = self._drawn(0, self._env.num_envs) >> 1
        self._collector.reset(drawn.tolist())
        self._learner.forget_returns()

    def _grow(self) -> None:
        """Lets rows draw from the training episodes that belong to the next update."""
        distill = self._recipe.distill
        before = 0 if distill is None else distill.rounds * distill.round_steps
        self._supply.grow(self._env, before + self._position.steps)

    def _generator(self, purpose: int, device: torch.device | None = None) -> torch.Generator:
        """Returns a new generator for this rank and update."""
        generator = torch.Generator(device=device or torch.device("cpu"))
        return generator.manual_seed(int(self._drawn(purpose, 1)[0]))

    def _drawn(self, purpose: int, count: int) -> np.ndarray:
        """Returns `count` seeds (count,) uint32 for this rank, update and purpose."""
        # Of the position alone, so that a continued run draws what an uninterrupted one would have.
        numbers = [self._plan.seed, self._ranks.rank, self._position.update, purpose]
        return np.random.SeedSequence(numbers).generate_state(count)

    def _about(self) -> dict[str, Any]:
        return {
            "recipe": to_json(self._recipe),
            "seed": self._plan.seed,
            "ranks": self._ranks.size,
            "position": checkpoint.position_json(self._position),
            "origin": self._origin,
        }

    def _save(self, name: str) -> None:
        tensors = checkpoint.learner_tensors(self._learner)
        checkpoint.save(self._plan.out / name, tensors, self._about())

    def _write_recipe(self) -> None:
        about = {"seed": self._plan.seed, "ranks": self._ranks.size, **to_json(self._recipe)}
        with written_aside(self._plan.out / RECIPE) as scratch:
            scratch.write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")


def run(options: TrainCommand) -> int:
    """Trains in this process, or starts the ranks that do.

    Raises:
        HabError: The run cannot start, or not continue, from the files given.
    """
    recipe = options.resolved_recipe()
    if is_rank():
        try:
            return _train(options, recipe)
        except KeyboardInterrupt:  # the launcher reports it, once
            return EXIT_INTERRUPTED
    options.check_out()
    if options.ranks == 1:
        return _train(options, recipe)
    _check(_plan(options, recipe))
    launch(options.ranks, options.arguments())
    return 0


def _check(plan: TrainPlan) -> None:
    """Rejects bad input here, once, and not in each rank."""
    check_start(plan)
    if plan.resume is not None:
        check_same(plan, load(plan.out / plan.resume)[1])
    check_episodes(plan.recipe)


def _plan(options: TrainCommand, recipe: Recipe) -> TrainPlan:
    # A run that was interrupted before its first update has neither; it begins where it was.
    checkpoint = EXACT if options.exact else LAST
    resumes = (options.resume or is_prepared()) and (options.out / checkpoint).exists()
    return TrainPlan(
        recipe=recipe,
        out=options.out,
        seed=options.seed,
        resume=checkpoint if resumes else None,
        demonstrations=options.demonstrations,
        teacher=options.teacher,
        weights=options.weights,
        command=options.command(),
    )


def _train(options: TrainCommand, recipe: Recipe) -> int:
    """Trains as this process's rank."""
    if not is_rank():
        check_start(_plan(options, recipe))
    ranks = Ranks()
    if is_rank() and not is_prepared() and ranks.is_first:
        options.check_out()
    plan = _plan(options, recipe)  # what it resumes from depends on the files left in the folder
    try:
        end = train_rank(plan, ranks, tell)
    finally:
        ranks.close()
    if ranks.is_first and end.best_success is not None:
        tell(
            f"{end.steps:,} steps in {end.seconds / 60:.1f} min; best {end.best_success:.0%} "
            f"at {end.best_steps:,} steps, in {plan.out / 'best.safetensors'}"
        )
    return 0
