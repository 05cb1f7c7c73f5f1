"""Training of the navigator: rounds of practice, each followed by a fit to all lessons so far."""

from __future__ import annotations

import shlex
import sys
import time
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch
from hab_eval.records.provenance import device, git_commit
from hab_ppo import checkpoint
from hab_ppo.checkpoint import PolicyFileError
from hab_ppo.distributed import compute_threads
from hab_ppo.progress import WriteLine
from hab_ppo.recipe import MOST_EPISODES, MOST_RANKS, MOST_ROWS

from hab_navigator.command import NavigatorCommand
from hab_navigator.lessons import Lessons, fit, misfit
from hab_navigator.network import KIND, WEIGHTS, GoalNetwork, load, save
from hab_navigator.practice import Played, PracticePlan, practise
from hab_tasks.episodes import EpisodeMaker, EpisodeRequest, Wanted
from hab_tasks.io.console import tell
from hab_tasks.io.files import check_folder
from hab_tasks.io.pool import WorkerPool, in_order
from hab_tasks.option_values import LARGEST_SEED, whole
from hab_tasks.skills.navigate import NAVIGATE_ID

LESSONS = "lessons.safetensors"
"""File of all fitted lessons in a run's folder, beside the weights."""

PLAYED = "played.safetensors"
"""File of the lessons of a round that have not been fitted yet."""

MAY_CHANGE: dict[str, Any] = {
    "out": "",
    "command": "",
    "workers": 0,
    "rounds": 0,
    "scene_dataset": "",
    "num_episodes": 0,
}
"""What may change when a run goes on; the description says for each round what it had."""

Solved = dict[str, list[int]]
"""By the skill whose start the goal is: solved episodes, and all."""

FIRST = 200
"""Number of training episodes that the first round draws from, besides as many as it plays."""

FIRST_SHARE = 0.25
"""Share of a round's episodes in the first one, in which the network knows nothing."""


@dataclass(frozen=True, kw_only=True)
class TrainingPlan:
    """A training run.

    Attributes:
        scene_dataset: Layouts of the training episodes.
        objects: Folder of the objects; None for the dataset's own.
        num_episodes: Number of training episodes, of which practice draws.
        rounds: Number of rounds.
        episodes: Episodes of a round.
        epochs: Epochs of each fit.
        rows: Simulations of each process.
        workers: Number of processes.
        seed: Seed of the run.
        out: The run's folder.
        command: The command that began it.
    """

    scene_dataset: str = "apartment"
    objects: str | None = None
    num_episodes: int = 3000
    rounds: int = 4
    episodes: int = 1000
    epochs: int = 10
    rows: int = 10
    workers: int = 2
    seed: int = 0
    out: Path = Path()
    command: str = ""


def run(options: NavigatorCommand) -> int:
    """Trains."""
    for name in ("rounds", "episodes", "epochs", "training_episodes"):
        whole(f"--{name.replace('_', '-')}", getattr(options, name), 1, MOST_EPISODES)
    whole("--rows", options.rows, 1, MOST_ROWS)
    whole("--workers", options.workers, 1, MOST_RANKS)
    whole("--seed", options.seed, 0, LARGEST_SEED)
    files = (WEIGHTS, PLAYED)
    if options.force or not any((options.out / name).is_file() for name in files):
        check_folder(options.out, force=options.force, mark=WEIGHTS)
        for name in (WEIGHTS, LESSONS, PLAYED):
            (options.out / name).unlink(missing_ok=True)
    plan = TrainingPlan(
        scene_dataset=options.scene_dataset,
        objects=options.objects,
        num_episodes=options.training_episodes,
        rounds=options.rounds,
        episodes=options.episodes,
        epochs=options.epochs,
        rows=options.rows,
        workers=options.workers,
        seed=options.seed,
        out=options.out,
        command=shlex.join(["hab-ppo", *sys.argv[1:]]),
    )
    train(plan, tell)
    tell(f"wrote {options.out / WEIGHTS}")
    return 0


def train(plan: TrainingPlan, write_line: WriteLine) -> None:
    """Trains a navigator; a run that was interrupted continues after its last round."""
    began = time.perf_counter()
    network, about, lessons = _started(plan)
    network.to("cuda" if torch.cuda.is_available() else "cpu")
    with _maker(plan) as maker:
        for number in range(len(about["rounds"]), plan.rounds):
            solved, new = _played(plan, number, maker)
            before = misfit(network, new)
            lessons = new if lessons is None else Lessons.joined([lessons, new])
            with compute_threads(plan.workers):
                last = fit(network, lessons, plan.epochs, plan.seed + number)
            entry = _entry(plan, solved, len(lessons.goals), before, last)
            about["rounds"].append(entry)
            about["seconds"] += time.perf_counter() - began
            began = time.perf_counter()
            checkpoint.save(plan.out / LESSONS, lessons.tensors(), {"kind": KIND})
            save(plan.out / WEIGHTS, network, about)
            (plan.out / PLAYED).unlink()
            write_line(
                f"round {number + 1} of {plan.rounds}: solved {entry['solved']} of "
                f"{entry['episodes']} episodes, {entry['lessons']:,} lessons, cross-entropy of new "
                f"ones {before:.3f}, of all after the fit {last:.3f}; "
                f"{about['seconds'] / 60:.1f} min"
            )


def _maker(plan: TrainingPlan) -> EpisodeMaker:
    """Starts to make the training episodes."""
    request = EpisodeRequest(
        env_id=NAVIGATE_ID,
        scene_dataset=plan.scene_dataset,
        objects=plan.objects,
        split="train",
    )
    first = Wanted(request, _drawn_from(plan, 0))
    return EpisodeMaker([first, Wanted(request, plan.num_episodes, later=True)], plan.workers)


def _started(plan: TrainingPlan) -> tuple[GoalNetwork, dict[str, Any], Lessons | None]:
    """Returns the state after the last complete round, or that of a new run."""
    path = plan.out / WEIGHTS
    facts = {**asdict(plan), **MAY_CHANGE}
    if not path.exists():
        torch.manual_seed(plan.seed)
        origin = {"command": plan.command, "device": device(), "git": git_commit()}
        about = {"kind": KIND, "plan": facts, "origin": origin, "rounds": [], "seconds": 0.0}
        return GoalNetwork().eval(), about, None
    network, about = load(path)
    before = {**about["plan"], **MAY_CHANGE}
    if before != facts:
        changed = sorted(name for name in facts if before.get(name) != facts[name])
        raise PolicyFileError(
            f"{path} is of a run with another {changed[0]}; give the same, or use --force."
        )
    lessons = Lessons.of_tensors(checkpoint.load(plan.out / LESSONS)[0])
    # A run that was killed between two files has more lessons than its weights know of.
    return network, about, lessons.chosen(torch.arange(about["rounds"][-1]["lessons"]))


def _played(plan: TrainingPlan, number: int, maker: EpisodeMaker) -> tuple[Solved, Lessons]:
    """Returns what a round has brought; it is played if that has not been done."""
    path = plan.out / PLAYED
    if path.exists():
        tensors, about = checkpoint.load(path)
        if about["round"] == number:
            return about["solved"], Lessons.of_tensors(tensors)
    played = _practised(plan, number, maker)
    lessons = Lessons.joined(played.lessons)
    solved = {skill: [sum(found), len(found)] for skill, found in sorted(played.solved.items())}
    checkpoint.save(path, lessons.tensors(), {"kind": KIND, "round": number, "solved": solved})
    return solved, lessons


def _drawn_from(plan: TrainingPlan, number: int) -> int:
    """Returns the number of training episodes that a round draws from: of 3,000, 450 at first."""
    return min(plan.num_episodes, FIRST + round(plan.episodes * (number + FIRST_SHARE)))


def _practised(plan: TrainingPlan, number: int, maker: EpisodeMaker) -> Played:
    """Plays the episodes of a round in several processes."""
    count = _drawn_from(plan, number)
    maker.wait(1, count)
    share = FIRST_SHARE if number == 0 else 1.0
    each = max(1, round(share * plan.episodes / (plan.rows * plan.workers)))
    plans = [
        PracticePlan(
            weights=plan.out / WEIGHTS if number else None,
            scene_dataset=plan.scene_dataset,
            objects=plan.objects,
            num_episodes=count,
            rows=plan.rows,
            each=each,
            seed=[plan.seed, number, worker],
        )
        for worker in range(plan.workers)
    ]
    with WorkerPool(plan.workers, partial, (practise,)) as pool:
        return Played.joined(list(in_order(pool.run(plans))))


def _entry(
    plan: TrainingPlan, solved: Solved, lessons: int, before: float, after: float
) -> dict[str, Any]:
    """Returns what the description says of a round."""
    return {
        "scene_dataset": plan.scene_dataset,
        "training_episodes": plan.num_episodes,
        "command": plan.command,
        "git": git_commit(),
        "episodes": sum(count for _, count in solved.values()),
        "solved": sum(count for count, _ in solved.values()),
        "by_skill": solved,
        "lessons": lessons,
        "misfit_of_new": before,
        "misfit_after": after,
    }
