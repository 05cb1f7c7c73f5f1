"""Demonstrations: an agent solves training episodes, and its paths are retimed and replayed.

Any agent in any control mode plays the recipe's episodes. Those that it solves are replayed in
the recipe's own environment (`hab_ppo.replay`); the replays that succeed are the demonstrations.
Each depends on the seed and its episode alone, so the number of processes does not matter.
"""

from __future__ import annotations

import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import torch
from hab_eval.records.config import EvalConfig
from hab_eval.run import environments
from hab_eval.run.agents import load_agent
from hab_eval.run.runner import run_episode

from hab_ppo.agent import spec_of
from hab_ppo.demonstration_file import Followed
from hab_ppo.episodes import training_source
from hab_ppo.examples import Examples
from hab_ppo.observation import ObservationLayout
from hab_ppo.progress import WriteLine
from hab_ppo.recipe import Recipe, RecipeError
from hab_ppo.replay import DRIVING_MODE, MODES, Disturbance, replay
from hab_ppo.retiming import Recorded, Stretch, straight, stretches, varied, within_workspace
from hab_tasks.agent import Agent, AgentSetup
from hab_tasks.agent_spaces import agent_setup
from hab_tasks.engine.rollout import Job, Outcome, StepInfo
from hab_tasks.episodes import Episode
from hab_tasks.errors import OptionError, RunStoppedError
from hab_tasks.io.pool import WorkerPool, in_order
from hab_tasks.io.threads import use_one_thread
from hab_tasks.registration import imported_id

FIRST_EPISODES = 25
"""An agent that has no demonstration after so many episodes is given up."""

MOST_REPLAYS = 4
"""Replays of a path until one succeeds: straight, as it is, then varied."""


@dataclass(frozen=True, kw_only=True)
class DemonstrationPlan:
    """Demonstrations to be made.

    Attributes:
        recipe: Its environment and training episodes are played.
        agent: ``module:factory``.
        count: Number of demonstrations.
        noise: Standard deviation of the noise on the actions, as a share of the largest action.
        seed: Seed of the noise.
        workers: Number of processes.
    """

    recipe: Recipe
    agent: str
    count: int
    noise: float = 0.5
    seed: int = 0
    workers: int = 1

    def config(self) -> EvalConfig:
        """Returns the agent's environment as an evaluation has it."""
        env = self.recipe.env
        return EvalConfig(
            agent=self.agent,
            env=env.reference,
            scene_dataset=env.scene_dataset,
            objects=env.objects,
            split=env.split,
            seed=env.episode_seed,
            env_options={"robot": env.robot} if env.robot else {},
        )


class Attempt(NamedTuple):
    """What came of an episode.

    Attributes:
        agent_failure: The agent's failure; None if it solved the episode.
        replay_failure: The replay's failure; None if it succeeded.
        examples: State, images and labels of a successful replay, as arrays; None without.
        followed: Its path; None without.
    """

    agent_failure: str | None
    replay_failure: str | None = None
    examples: tuple[Any, Any, Any] | None = None
    followed: Followed | None = None


@dataclass(kw_only=True)
class Demonstrations:
    """Result of a `DemonstrationPlan`.

    Attributes:
        parts: One demonstration each.
        followed: Their paths.
        episodes: Number of episodes played.
        agent_failures: Failure -> number of episodes that the agent did not solve.
        replay_failures: Failure -> number of replays that did not succeed.
    """

    parts: list[Examples] = field(default_factory=list)
    followed: list[Followed] = field(default_factory=list)
    episodes: int = 0
    agent_failures: Counter[str] = field(default_factory=Counter)
    replay_failures: Counter[str] = field(default_factory=Counter)

    def add(self, attempt: Attempt) -> None:
        """Counts an episode, and keeps its demonstration."""
        self.episodes += 1
        if attempt.agent_failure is not None:
            self.agent_failures[attempt.agent_failure] += 1
        elif attempt.examples is None or attempt.followed is None:
            self.replay_failures[str(attempt.replay_failure)] += 1
        else:
            state, images, actions = attempt.examples
            part = Examples(
                state=torch.from_numpy(state),
                images=None if images is None else torch.from_numpy(images),
                actions=torch.from_numpy(actions),
                lengths=torch.tensor([len(state)]),
            )
            self.parts.append(part)
            self.followed.append(attempt.followed)

    def counts(self) -> dict[str, Any]:
        """Returns the numbers for the description of a file."""
        return {
            "episodes": self.episodes,
            "solved": self.episodes - self.agent_failures.total(),
            "demonstrations": len(self.parts),
            "agent_failures": dict(self.agent_failures),
            "replay_failures": dict(self.replay_failures),
        }

    def summary(self) -> str:
        """Returns the numbers in a line."""
        solved = self.episodes - self.agent_failures.total()
        return (
            f"the agent solved {solved} of {self.episodes} episodes{_listed(self.agent_failures)}, "
            f"{len(self.parts)} of {solved} replays succeeded{_listed(self.replay_failures)}"
        )


def demonstrate(plan: DemonstrationPlan, write_line: WriteLine) -> Demonstrations:
    """Makes demonstrations, in the order of the training episodes.

    Raises:
        RecipeError: The recipe's control mode has no end-effector.
        HabError: The agent is unknown or does not support the environment.
        RunStoppedError: The agent or an environment raised, or nothing succeeded.
    """
    if plan.recipe.env.control_mode not in MODES:
        raise RecipeError(
            f"Demonstrations are retimed into the control modes {' and '.join(MODES)}; "
            f"{plan.recipe.name} has {plan.recipe.env.control_mode}."
        )
    load_agent(plan.agent, _setup(plan))  # bad names are reported here, and not by a worker
    made, most = Demonstrations(), plan.recipe.env.num_episodes
    with _attempts(plan, most) as attempts:
        for attempt in attempts:
            made.add(attempt)
            done = len(made.parts)
            if made.episodes >= min(FIRST_EPISODES, most) and not done:
                break
            if attempt.examples is not None and done % max(1, plan.count // 10) == 0:
                write_line(f"{done} of {plan.count} demonstrations: {made.summary()}")
            if done == plan.count:
                break
    if not made.parts:
        raise RunStoppedError(f"There are no demonstrations of {plan.agent}: {made.summary()}.")
    return made


@contextmanager
def _attempts(plan: DemonstrationPlan, most: int) -> Iterator[Iterator[Attempt]]:
    """Yields the attempts at the first `most` episodes, in order, as they are asked for."""
    if plan.workers <= 1:
        studio = Studio(plan)
        try:
            yield map(studio.attempt, range(most))
        finally:
            studio.close()
        return
    with WorkerPool(plan.workers, _start_worker, (plan,)) as pool:
        yield in_order(pool.run(range(most)))


class Studio:
    """The agent with its environment, and the recipe's environment, in one process."""

    def __init__(self, plan: DemonstrationPlan) -> None:
        use_one_thread()
        self._plan, recipe = plan, plan.recipe
        most = recipe.env.num_episodes
        self._source = training_source(recipe)
        self._agent: Agent = load_agent(plan.agent, _setup(plan))
        config, spec = plan.config(), self._agent.spec
        self._stage = environments.make_env(
            config, spec, split=recipe.env.split, render=False, num_episodes=most
        )
        entry = environments.gripper_entry(
            imported_id(config.env), spec.control_mode, recipe.env.robot
        )
        self._path = _PathRecorder(entry)
        self._env: Any = gym.make(recipe.env.reference, num_envs=1, **recipe.env.options())
        self._drives = recipe.env.control_mode == DRIVING_MODE
        spaces = _setup(plan).spaces(spec_of(recipe))
        block_px = recipe.preset.network.image_block_px
        self._layout = ObservationLayout.of(spaces.observation, block_px)

    def attempt(self, number: int) -> Attempt:
        """Plays a training episode with the agent and replays it.

        Raises:
            RunStoppedError: The agent or an environment raised.
        """
        episode = self._source.get(number)
        try:
            return self._attempted(number, episode)
        except Exception as error:
            raise RunStoppedError(
                f"Episode {episode.id!r} stopped the demonstrations: {type(error).__name__}: "
                f"{str(error).rstrip('.')}.",
                details=traceback.format_exc(),
            ) from error

    def _attempted(self, number: int, episode: Episode) -> Attempt:
        result = run_episode(self._stage, self._agent, number, episode, [self._path]).episode
        if not result.success:
            return Attempt(agent_failure=str(result.failure))
        path, failure = stretches(self._path.recorded()), None
        if self._drives:
            path = within_workspace(path, self._env.get_wrapper_attr("robot"))
        for replays in range(MOST_REPLAYS):
            drawn = np.random.default_rng([self._plan.seed, number, replays])
            followed = _version(path, replays, drawn)
            disturbance = Disturbance(self._plan.noise, drawn)
            failure, examples = replay(self._env, self._layout, episode, followed, disturbance)
            if failure is None:
                images = None if examples.images is None else examples.images.numpy()
                arrays = examples.state.numpy(), images, examples.actions.numpy()
                done = Followed(number, followed)
                return Attempt(agent_failure=None, examples=arrays, followed=done)
        return Attempt(agent_failure=None, replay_failure=failure)

    def close(self) -> None:
        """Frees the simulators."""
        self._stage.close()
        self._env.close()


class _PathRecorder:
    """Records the hand's path and the gripper's and the base's entries of an episode."""

    def __init__(self, gripper: int | None) -> None:
        if gripper is None:
            raise OptionError("The agent does not control the gripper, so it shows no path.")
        self._gripper = gripper
        self._points: list[Any] = []
        self._actions: list[Any] = []

    def reset(self, job: Job, seen: StepInfo) -> None:
        """Starts a recording."""
        self._points, self._actions = [], []
        self._see(seen)

    def step(self, seen: StepInfo) -> None:
        """Records a step."""
        self._actions.append(np.asarray(seen.action, dtype=float).reshape(-1))
        self._see(seen)

    def end(self, outcome: Outcome | None) -> None:
        """Keeps the recording."""

    def recorded(self) -> Recorded:
        """Returns the last episode."""
        actions = np.stack(self._actions)
        drives = actions[:, self._gripper + 1 :]
        if drives.shape[1] != 2:  # a base that stands, or whose pose is set directly
            drives = np.zeros((len(actions), 2))
        return Recorded(np.stack(self._points), actions[:, self._gripper], drives)

    def _see(self, seen: StepInfo) -> None:
        self._points.append(np.asarray(seen.obs["agent"]["ee_position"][0]).astype(float))


def _start_worker(plan: DemonstrationPlan) -> Callable[[int], Attempt]:
    return Studio(plan).attempt


def _version(path: list[Stretch], replays: int, drawn: np.random.Generator) -> list[Stretch]:
    """Returns the path of a replay, by the number of those before it."""
    if replays == 0:
        return straight(path)
    return path if replays == 1 else varied(path, drawn)


def _setup(plan: DemonstrationPlan) -> AgentSetup:
    env = plan.recipe.env
    return agent_setup(env.reference, seed=env.episode_seed, robot=env.robot_reference)


def _listed(failures: Counter[str]) -> str:
    """Returns failures by their number, in brackets."""
    words = [f"{count} {name}" for name, count in failures.most_common()]
    return f" ({', '.join(words)})" if words else ""
