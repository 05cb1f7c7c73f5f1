"""DAgger (arXiv 1011.0686): a student learns what a teacher would do in the states it visits.

The student plays the vector environment of its own recipe, for example with images. The teacher
(`hab_ppo.teachers`) labels every state. All ranks of a run play. The first one keeps the data of
all rounds, and after each round it fits the student to all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from safetensors.torch import load, save
from torch import Tensor

from hab_ppo.cloning import Fit, clone
from hab_ppo.distributed import Ranks
from hab_ppo.examples import Examples, compact
from hab_ppo.network import Policy
from hab_ppo.noise import ActionNoise
from hab_ppo.observation import Observation
from hab_ppo.progress import WriteLine
from hab_ppo.recipe import Distillation
from hab_ppo.teachers import Teacher
from hab_tasks.io.threads import compute_threads

COUNTS = "counts"


@dataclass(kw_only=True)
class Visits:
    """What happened in a round.

    Attributes:
        parts: The visited states with the teacher's actions, an episode each.
        episodes: Number of episodes that ended.
        successes: Number of solved ones.
    """

    parts: list[Examples] = field(default_factory=list)
    episodes: int = 0
    successes: int = 0

    @classmethod
    def joined(cls, several: Sequence[Visits]) -> Visits:
        """Returns what happened in several parts of a round."""
        return cls(
            parts=[part for visits in several for part in visits.parts],
            episodes=sum(visits.episodes for visits in several),
            successes=sum(visits.successes for visits in several),
        )

    def written(self) -> bytes:
        """Returns this as bytes in the safetensors format."""
        tensors = Examples.joined(self.parts).tensors()
        return save(tensors | {COUNTS: torch.tensor([self.episodes, self.successes])})

    @classmethod
    def read(cls, data: bytes) -> Visits:
        """Returns what bytes of `written` tell."""
        tensors = load(data)
        parts, counts = Examples.of_tensors(tensors).split(), tensors[COUNTS].tolist()
        return cls(parts=parts, episodes=counts[0], successes=counts[1])


def distill(
    student: Policy,
    teacher: Teacher,
    env: Any,
    config: Distillation,
    seed: int,
    ranks: Ranks,
    write_line: WriteLine,
    *,
    done: int = 0,
    keep: Callable[[int], None] = lambda done: None,
) -> Fit:
    """Fits a student to a teacher; returns the last fit, which only the first rank makes.

    Args:
        student: The policy that learns.
        teacher: Labels the states.
        env: This rank's vector environment, in autoreset mode `NEXT_STEP`.
        config: The rounds.
        seed: Seed of episodes, actions and fits.
        ranks: The ranks of the run.
        write_line: Receives progress lines.
        done: Number of rounds that the student has had. Their data are not there any more.
        keep: Called by the first rank after each round with the number of rounds so far.
    """
    student.head.explore(config.tuning.log_std)
    parts: list[Examples] = []
    fit = Fit(epochs=0, loss=0.0, held_out_loss=0.0)
    for number in range(done, config.rounds):
        _share(student, ranks)
        beta = config.beta if number == 0 else 0.0
        steps = -(-config.round_steps // ranks.size)
        own = visit(student, teacher, env, steps, beta, [seed, number, ranks.rank])
        visits = Visits.joined([Visits.read(data) for data in ranks.to_first(own.written())])
        if not ranks.is_first:
            continue
        parts = newest(parts + visits.parts, config.most_mb)
        with compute_threads(ranks.on_machine):  # the others wait
            fit = clone(student, Examples.joined(parts), config.cloning, seed + number, write_line)
        steps = sum(len(part.state) for part in parts)
        write_line(
            f"distillation, round {number + 1} of {config.rounds}: solved {visits.successes} of "
            f"{visits.episodes} episodes, {steps:,} labelled steps, held out "
            f"{fit.held_out_loss:.4f}"
        )
        keep(number + 1)
    return fit


def _share(student: Policy, ranks: Ranks) -> None:
    """Gives all ranks the first one's student."""
    if ranks.size > 1:
        tensors = {name: value.contiguous() for name, value in student.state_dict().items()}
        student.load_state_dict(load(ranks.from_first(save(tensors))))


def newest(parts: list[Examples], most_mb: int) -> list[Examples]:
    """Returns the last episodes that fit into so much memory, at least one."""
    total, first = 0.0, len(parts)
    while first > 0:
        total += parts[first - 1].megabytes
        if total > most_mb and first < len(parts):
            break
        first -= 1
    return parts[first:]


def visit(
    student: Policy, teacher: Teacher, env: Any, steps: int, beta: float, seed: list[int]
) -> Visits:
    """Plays a round from the start of new episodes; every visited state gets its label.

    Args:
        student: Acts with noise.
        teacher: Labels the states.
        env: The vector environment.
        steps: Number of labelled states.
        beta: Share of the steps in which the teacher's action is executed.
        seed: Seed of the round.
    """
    drawn, rows = np.random.default_rng(seed), env.num_envs
    device = student.state_normalizer.mean.device
    generator = torch.Generator(device=device).manual_seed(int(drawn.integers(2**31)))
    noise = ActionNoise(generator)
    seeds = [int(one) for one in drawn.integers(2**31, size=rows)]
    obs, _ = env.reset(seed=seeds, options={"reconfigure": True})
    recorder, result = Recorder(rows), Visits()
    starts, ended = torch.ones(rows, dtype=torch.bool), np.zeros(rows, dtype=bool)
    memory = student.no_memory(rows)
    taken = 0
    while taken < steps:
        seen = student.layout.read(obs)
        acted = student.choose(seen.to(device), memory, starts.to(device), noise)
        memory, labels = acted.memory, teacher.labels(obs, starts)
        leads = (drawn.random(rows) < beta).reshape(rows, *[1] * (labels.ndim - 1))
        actions = np.where(leads, labels, student.head.to_env(acted.actions))
        recorder.put(seen, labels, ~ended)
        taken += int((~ended).sum())
        starts = torch.from_numpy(ended.copy())
        obs, _, terminated, truncated, info = env.step(actions.astype(labels.dtype))
        ended = terminated | truncated
        result.episodes += int(ended.sum())
        result.successes += int(info["success"][ended].sum())
        result.parts += recorder.ended(ended)
    result.parts += recorder.ended(np.ones(rows, dtype=bool))
    return result


class Recorder:
    """Keeps the running episode of each row."""

    def __init__(self, rows: int) -> None:
        self._seen: list[list[Observation]] = [[] for _ in range(rows)]
        self._labels: list[list[Any]] = [[] for _ in range(rows)]

    def put(self, seen: Observation, labels: Any, valid: Any) -> None:
        """Adds a step of the rows in `valid`."""
        images: Tensor | None = None if seen.images is None else compact(seen.images)
        for row in np.flatnonzero(valid):
            shown = None if images is None else images[row : row + 1]
            self._seen[row].append(Observation(seen.state[row : row + 1], shown))
            self._labels[row].append(labels[row].copy())

    def ended(self, ended: Any) -> list[Examples]:
        """Returns the episodes of the rows in `ended`, and forgets them."""
        parts = []
        for row in np.flatnonzero(ended):
            if self._seen[row]:
                parts.append(Examples.of(self._seen[row], np.stack(self._labels[row])))
            self._seen[row], self._labels[row] = [], []
        return parts
