"""DAgger (arXiv 1011.0686): a student learns what a teacher would do in the states it visits.

The student plays the vector environment of its own recipe, for example with images. The teacher,
a trained policy or a scripted expert, labels every state. All ranks of a run play. The first one
keeps the data of all rounds, and after each round it fits the student to all of them.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from inspect import signature
from pathlib import Path
from typing import Any, Protocol

import hab_experts
import numpy as np
import torch
from numpy.typing import NDArray
from safetensors.torch import load, save
from torch import Tensor

from hab_ppo.actions import ActionNoise
from hab_ppo.agent import WEIGHTS, LoadedPolicy, load_policy, weights_file
from hab_ppo.checkpoint import PolicyFileError
from hab_ppo.cloning import Fit, clone
from hab_ppo.distributed import Ranks, compute_threads
from hab_ppo.examples import Examples, compact
from hab_ppo.network import Policy
from hab_ppo.observation import Observation
from hab_ppo.progress import WriteLine
from hab_ppo.recipe import Distillation, EnvConfig, RecipeError
from hab_ppo.rows import Student, VectorRows
from hab_tasks.agent_spaces import agent_setup
from hab_tasks.engine.rollout import EndRolloutError, Job, Outcome, play
from hab_tasks.envs import ENVS
from hab_tasks.registration import imported_id


class Teacher(Protocol):
    """Tells what to do in the states of a vector environment."""

    def labels(self, obs: Any, starts: Tensor) -> NDArray[Any]:
        """Returns the best actions, as the environment takes them, (N, ...).

        Args:
            obs: The environment's observation.
            starts: (N,) bool, true where an episode starts.
        """
        ...


class PolicyTeacher:
    """A policy, with its most likely actions."""

    def __init__(self, policy: Policy, rows: int) -> None:
        """Teaches in an environment of `rows` with a policy on the CPU."""
        self._policy, self._memory = policy, policy.no_memory(rows)

    def labels(self, obs: Any, starts: Tensor) -> NDArray[Any]:
        """See `Teacher`."""
        acted = self._policy.choose(self._policy.layout.read(obs), self._memory, starts)
        self._memory = acted.memory
        return self._policy.head.to_env(acted.actions)


class Expert:
    """A scripted expert (`hab_experts`), which knows more than can be observed."""

    def __init__(self, env: Any, name: str, repeat: int = 1) -> None:
        """Teaches in a vector environment, which repeats actions."""
        self._env, self._function = env, f"{hab_experts.__name__}:{name}"
        self._named = {} if repeat == 1 else {"repeat": repeat}

    def labels(self, obs: Any, starts: Tensor) -> NDArray[Any]:
        """See `Teacher`."""
        return np.concatenate(self._env.call("ask", self._function, **self._named))


def check_expert(name: str, env: EnvConfig) -> None:
    """Rejects an expert that does not master a skill.

    Raises:
        RecipeError: There is no such expert, or one that does not know of repeated actions.
    """
    skill = ENVS[imported_id(env.reference)].env.name
    if skill not in hab_experts.SKILLS.get(name, ()):
        raise RecipeError(f"{env.env} has no expert {name}.")
    known = signature(getattr(hab_experts, name)).parameters
    if env.action_repeat > 1 and "repeat" not in known:
        raise RecipeError(f"The expert {name} needs action_repeat 1, not {env.action_repeat}.")


def known_weights(name: str, option: str) -> Path:
    """Returns the file of weights of a policy that ships, of a run, or itself.

    Args:
        name: The policy's name or a path.
        option: The option of ``hab-ppo train`` for them.

    Raises:
        PolicyFileError: There are none.
    """
    path = weights_file(Path(name))
    shipped = WEIGHTS / f"{name}.safetensors"
    if path.is_file():
        return path
    if shipped.is_file():
        return shipped
    raise PolicyFileError(
        f"There are no weights {name}: train them, and give the run's folder as {option} DIR."
    )


def load_teacher(path: Path, env: EnvConfig) -> LoadedPolicy:
    """Returns the policy of a file of weights.

    Args:
        path: The file.
        env: The student's environment.

    Raises:
        PolicyFileError: The file cannot be used.
        RecipeError: The teacher acts in another environment.
    """
    teacher = load_policy(agent_setup(env.reference, robot=env.robot_reference), path)
    recipe = teacher.recipe
    if imported_id(recipe.env.reference) != imported_id(env.reference):
        raise RecipeError(f"The teacher {path} acts in {recipe.env.env}, not {env.env}.")
    for name in ("control_mode", "target_frame"):
        if getattr(recipe.env, name) != getattr(env, name):
            raise RecipeError(
                f"The teacher {path} has {name} {getattr(recipe.env, name)!r}, not "
                f"{getattr(env, name)!r}."
            )
    return teacher


def classroom(env: EnvConfig, teacher: LoadedPolicy) -> EnvConfig:
    """Returns the student's environment, in which the teacher sees all that it observes.

    The student's own observation stays as it is: a teacher that observes a handle can teach one
    that has to find it in images.

    Raises:
        RecipeError: The teacher has images that the student does not have.
    """
    own = teacher.recipe.env
    if not own.obs_mode.startswith("state") and own.obs_mode != env.obs_mode:
        raise RecipeError(
            f"The teacher {own.env} observes {own.obs_mode}, the student {env.obs_mode}."
        )
    return replace(env, handle_position=env.handle_position or own.handle_position)


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

    def count(self, outcome: Outcome, parts: list[Examples]) -> None:
        """Counts an episode that has ended, and keeps its states."""
        self.episodes += 1
        self.successes += outcome.success
        self.parts += parts

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
    begin: Callable[[int], None] = lambda number: None,
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
        begin: Called before each round with its number.
        keep: Called by the first rank after each round with the number of rounds so far.
    """
    student.head.explore(config.tuning.log_std)
    parts: list[Examples] = []
    fit = Fit(epochs=0, loss=0.0, held_out_loss=0.0)
    for number in range(done, config.rounds):
        _share(student, ranks)
        begin(number)
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


class _Taught(Student):
    """Acts as the student or as its teacher, who labels every state, for a number of steps."""

    def __init__(
        self,
        student: Policy,
        rows: VectorRows,
        teacher: Teacher,
        drawn: np.random.Generator,
        *,
        noise: ActionNoise,
        steps: int,
        beta: float,
    ) -> None:
        super().__init__(student, rows, noise)
        self._teacher, self._drawn, self._left, self._beta = teacher, drawn, steps, beta
        self.recorder = Recorder(rows.count)

    def act(self, obs: Any) -> NDArray[Any]:
        """Returns actions as the environment takes them, (N, ...)."""
        if self._left <= 0:
            raise EndRolloutError
        rows, seen = self.rows, self.policy.layout.read(obs)
        chosen = self.choose(seen)
        labels = self._teacher.labels(obs, torch.from_numpy(rows.fresh))
        leads = self._drawn.random(rows.count) < self._beta
        self.recorder.put(seen, labels, ~rows.over)
        self._left -= int((~rows.over).sum())
        leads = leads.reshape(rows.count, *[1] * (labels.ndim - 1))
        return np.where(leads, labels, chosen).astype(labels.dtype)


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
    drawn = np.random.default_rng(seed)
    device = student.state_normalizer.mean.device
    generator = torch.Generator(device=device).manual_seed(int(drawn.integers(2**31)))
    rows = VectorRows(env, drawn.integers(2**31, size=env.num_envs).tolist())
    noise = ActionNoise(generator)
    taught = _Taught(student, rows, teacher, drawn, noise=noise, steps=steps, beta=beta)
    visits = Visits()
    for ended in play(rows, taught, map(Job, itertools.count())):
        visits.count(ended.outcome, taught.recorder.ended([ended.row]))
    visits.parts += taught.recorder.ended(range(rows.count))
    return visits


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

    def ended(self, rows: Iterable[int]) -> list[Examples]:
        """Returns the episodes of `rows`, and forgets them."""
        parts = []
        for row in rows:
            if self._seen[row]:
                parts.append(Examples.of(self._seen[row], np.stack(self._labels[row])))
            self._seen[row], self._labels[row] = [], []
        return parts
