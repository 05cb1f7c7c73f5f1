"""Recording of an agent's successful episodes as ManiSkill trajectories.

ManiSkill's own wrapper writes `trajectory.h5` and `trajectory.json`, and its replay tool replays
them. Resets identify the episode by its index in the set given by the environment's arguments, so
that the start state is reproducible on any machine.
"""

from __future__ import annotations

import json
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium as gym
from hab_eval.records.config import EvalConfig
from hab_eval.records.results import EpisodeResult
from hab_eval.run import environments
from hab_eval.run.agents import load_agent
from hab_eval.run.runner import run_episode
from mani_skill.utils.wrappers.record import RecordEpisode

from hab_spa.cli import RecordCommand
from hab_tasks.engine.rollout import Job
from hab_tasks.envs import ENVS
from hab_tasks.episodes import Episode, open_source
from hab_tasks.errors import OptionError, RunStoppedError
from hab_tasks.io.console import tell
from hab_tasks.io.executors import ExecutorChoice
from hab_tasks.io.files import check_file, check_folder, replace_folder, scratch_folder
from hab_tasks.io.threads import use_one_thread
from hab_tasks.option_values import MOST_WORKERS, whole
from hab_tasks.registration import imported_id, reference_of

EXIT_TOO_FEW = 1

MOST_FOR_EACH = 10
"""Default maximum number of episodes per demonstration."""

NAME = "trajectory"
LEROBOT = "lerobot"
LEROBOT_MARK = "meta/info.json"


@dataclass(frozen=True, kw_only=True)
class RecordPlan:
    """Options of a recording.

    Attributes:
        config: Agent, environment and episode set; `config.episodes` is the number of
            demonstrations.
        out: Output folder.
        most: Maximum number of episodes.
        lerobot: Also write a LeRobot dataset, to the folder `lerobot`.
        force: Overwrite files in `out`.
        workers: Number of workers on Ray.
        executor: Where the episodes are played.
    """

    config: EvalConfig
    out: Path
    most: int
    lerobot: bool = False
    force: bool = False
    workers: int = 1
    executor: ExecutorChoice = field(default_factory=ExecutorChoice)

    def __post_init__(self) -> None:
        self.executor.check_executor()
        whole("workers", self.workers, 1, MOST_WORKERS)
        if self.workers > 1 and not self.executor.is_remote:
            raise OptionError("--workers of a recording needs --executor ray.")
        if self.most < self.config.episodes:
            raise OptionError(
                f"most must be at least count, {self.config.episodes}, got {self.most}."
            )


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """Result of a recording.

    Attributes:
        demonstrations: Number of successful episodes, all written.
        episodes: Number of episodes run.
        failures: Failure category -> number of episodes.
        files: Files written.
    """

    demonstrations: int
    episodes: int
    failures: Mapping[str, int]
    files: tuple[Path, ...]


OnEpisode = Callable[[EpisodeResult], None]
"""Called after each episode."""


def run(options: RecordCommand) -> int:
    """Records demonstrations and prints the result of each episode."""
    most = MOST_FOR_EACH * options.count if options.most is None else options.most
    plan = RecordPlan(
        config=options.config_of(options.count),
        out=options.out,
        most=most,
        lerobot=options.lerobot,
        force=options.force,
        workers=options.workers,
        executor=ExecutorChoice(executor=options.executor, address=options.address),
    )

    def print_result(result: EpisodeResult) -> None:
        ended = "solved" if result.success else f"failed: {result.failure}"
        tell(f"{result.id}: {ended}, {result.steps} steps")

    recorded = record(plan, print_result)
    for failure, number in sorted(recorded.failures.items()):
        tell(f"{number} of {recorded.episodes} episodes failed: {failure}")
    for file in recorded.files:
        tell(f"wrote {file}")
    tell(f"{recorded.demonstrations} of {options.count} demonstrations")
    return 0 if recorded.demonstrations == options.count else EXIT_TOO_FEW


def record(plan: RecordPlan, on_episode: OnEpisode) -> Recorded:
    """Runs episodes until enough have succeeded, and writes their trajectories.

    Files in `plan.out` are replaced only at the end, after a complete recording.

    Raises:
        HabError: An invalid name or value, or files that exist already.
        RunStoppedError: The agent or the environment raised; the message has the episode.
    """
    environments.check_env_id(plan.config.env)
    targets = _targets(plan)
    if plan.lerobot:
        # It needs pyarrow, which is optional; here it raises before the first episode.
        from hab_spa.recording import lerobot_format
    play = _play
    if plan.executor.is_remote:
        # It is built on this module.
        from hab_spa.recording.distributed import play_distributed as play
    with scratch_folder(plan.out) as scratch:
        results = play(plan, scratch, on_episode)
        solved = [result for result in results if result.success]
        if not solved:
            targets = []
        elif plan.lerobot:
            robot = ENVS[imported_id(plan.config.env)].env.robot
            lerobot_format.write_dataset(scratch / f"{NAME}.h5", scratch / LEROBOT, robot)
        for target in targets:
            written = scratch / target.name
            if written.is_dir():
                replace_folder(written, target)
            else:
                written.replace(target)
    return Recorded(
        demonstrations=len(solved),
        episodes=len(results),
        failures=Counter(str(result.failure) for result in results if not result.success),
        files=tuple(targets),
    )


def describe_task(env_id: str, episode: Episode) -> str:
    """Returns the instruction of an episode, with the names of its objects."""
    return ENVS[env_id].env.instruct(episode)


def _numbered(env: gym.Env[Any, Any], job: Job) -> tuple[Any, dict[str, Any]]:
    """Starts an episode by its index, which can be stored in a file and replayed."""
    return env.reset(seed=job.episode.seed, options={"episode": job.index, "reconfigure": True})


def _targets(plan: RecordPlan) -> list[Path]:
    """Returns the files to write; raises if one exists and `plan.force` is not set."""
    targets = [plan.out / f"{NAME}.h5", plan.out / f"{NAME}.json"]
    for target in targets:
        check_file(target, force=plan.force)
    if plan.lerobot:
        targets.append(plan.out / LEROBOT)
        check_folder(targets[-1], force=plan.force, mark=LEROBOT_MARK)
    return targets


def _play(plan: RecordPlan, scratch: Path, on_episode: OnEpisode) -> list[EpisodeResult]:
    """Runs the episodes; writes the two files of the successful ones to `scratch`."""
    player = Player(plan, scratch)
    try:
        numbers = range(min(plan.most, player.source.available))
        results = play_until(plan, map(player.play, numbers), on_episode)
    finally:
        player.close()
    solved = [number for number, result in enumerate(results) if result.success]
    annotate(scratch / f"{NAME}.json", plan.config.env, [player.source.get(n) for n in solved])
    return results


class Player:
    """Plays episodes by number; the successful ones are in the two files of `folder`."""

    def __init__(self, plan: RecordPlan, folder: Path) -> None:
        """Creates agent and environment."""
        use_one_thread()  # as in an evaluation
        config = plan.config
        self._agent = load_agent(config.agent, environments.setup_of(config))
        self.source = open_source(environments.request_of(config))
        env: Any = environments.make_env(
            config, self._agent.spec, split=self.source.split, render=False, num_episodes=plan.most
        )
        self._recorder = RecordEpisode(
            env,
            str(folder),
            trajectory_name=NAME,
            save_video=False,
            save_on_reset=False,
            source_desc=f"{self._agent.spec.name} ({config.agent}), recorded by hab-spa record",
        )

    def play(self, number: int) -> EpisodeResult:
        """Plays an episode; keeps its trajectory if it succeeds.

        Raises:
            RunStoppedError: The agent or the environment raised.
        """
        episode, recorder = self.source.get(number), self._recorder
        try:
            result = run_episode(recorder, self._agent, number, episode, restart=_numbered).episode
        except Exception as error:
            raise RunStoppedError(
                f"Episode {episode.id!r} stopped the recording: {type(error).__name__}: "
                f"{str(error).rstrip('.')}. Nothing was written; --verbose shows the traceback.",
                details=traceback.format_exc(),
            ) from error
        recorder.flush_trajectory(save=result.success)
        return result

    def close(self) -> None:
        """Completes the files and frees the simulator."""
        self._recorder.close()


def play_until(
    plan: RecordPlan, results: Iterable[EpisodeResult], on_episode: OnEpisode
) -> list[EpisodeResult]:
    """Returns the results, in order, up to the one that completes the demonstrations."""
    found: list[EpisodeResult] = []
    solved = 0
    for result in results:
        found.append(result)
        on_episode(result)
        solved += result.success
        if solved == plan.config.episodes:
            break
    return found


def annotate(file: Path, env_id: str, episodes: Sequence[Episode]) -> None:
    """Adds the environment's module, and each episode's id and task, to ManiSkill's file."""
    data = json.loads(file.read_text(encoding="utf-8"))
    # With the module in the id, Gymnasium imports it itself.
    data["env_info"]["env_id"] = reference_of(imported_id(env_id))
    for entry, episode in zip(data["episodes"], episodes, strict=True):
        entry |= {"episode": episode.id, "task": describe_task(env_id, episode)}
    file.write_text(json.dumps(data, indent=2) + "\n", encoding="utf-8")
