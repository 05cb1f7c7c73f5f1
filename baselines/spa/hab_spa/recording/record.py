"""Demonstrations: the episodes that an agent solves, recorded as ManiSkill trajectories.

`trajectory.h5` and `trajectory.json` are written by ManiSkill's own wrapper, and its replay tool
plays them: every episode is asked for by its number in the set that the environment's arguments
name, so that the same start comes back on any machine.
"""

from __future__ import annotations

import json
import shutil
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
from hab_eval import environments
from hab_eval.config import EvalConfig
from hab_eval.errors import OptionError, RunStoppedError
from hab_eval.load_agent import load_agent
from hab_eval.results import EpisodeResult
from hab_eval.runner import run_episode
from mani_skill.utils.wrappers.record import RecordEpisode

from hab_tasks.agent import Agent
from hab_tasks.envs import ENVS
from hab_tasks.episodes import Episode, EpisodeRequest, open_source
from hab_tasks.episodes.source import EpisodeSource
from hab_tasks.files import check_file, check_folder, scratch_folder
from hab_tasks.instructions import instruction
from hab_tasks.processes import use_one_thread

NAME = "trajectory"
LEROBOT = "lerobot"
LEROBOT_MARK = "meta/info.json"


@dataclass(frozen=True, kw_only=True)
class RecordPlan:
    """What is recorded.

    Attributes:
        config: Agent, environment and episode set; `config.episodes` demonstrations are wanted.
        out: Folder of the files.
        most: Give up after so many episodes.
        lerobot: Write LeRobot's dataset format as well, into the folder `lerobot`.
        force: Replace what is in `out`.
    """

    config: EvalConfig
    out: Path
    most: int
    lerobot: bool = False
    force: bool = False

    def __post_init__(self) -> None:
        if self.most < self.config.episodes:
            raise OptionError(
                f"most must be at least count, {self.config.episodes}, got {self.most}."
            )


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """How a recording went.

    Attributes:
        demonstrations: Episodes that were solved, and written.
        episodes: Episodes that were played.
        failures: Why the others failed -> how many.
        files: What was written.
    """

    demonstrations: int
    episodes: int
    failures: Mapping[str, int]
    files: tuple[Path, ...]


Told = Callable[[EpisodeResult], None]
"""Called after each episode."""


def record(plan: RecordPlan, told: Told) -> Recorded:
    """Plays episodes until enough are solved, and writes those.

    Nothing in `plan.out` changes before all is written, or if the recording ends early.

    Raises:
        HabError: A bad name or value, or files in the way.
        RunStoppedError: The agent or the environment raised; names the episode.
    """
    environments.check_env_id(plan.config.env)
    targets = _targets(plan)
    if plan.lerobot:  # refuses, before minutes are spent, when pyarrow is missing
        from hab_spa.recording import lerobot_format
    with scratch_folder(plan.out) as scratch:
        results = _play(plan, scratch, told)
        solved = [result for result in results if result.success]
        if not solved:
            targets = []
        elif plan.lerobot:
            lerobot_format.write_dataset(scratch / f"{NAME}.h5", scratch / LEROBOT)
        for target in targets:
            if target.is_dir():
                shutil.rmtree(target)
            (scratch / target.name).replace(target)
    return Recorded(
        demonstrations=len(solved),
        episodes=len(results),
        failures=Counter(str(result.failure) for result in results if not result.success),
        files=tuple(targets),
    )


def describe_task(env_id: str, episode: Episode) -> str:
    """Returns what is to be done in words, with the names of the objects."""
    return instruction(ENVS[env_id].env, episode)


class _Numbered(gym.Wrapper[Any, Any, Any, Any]):
    """Asks for episodes by their number, which a file can hold and a replay can ask for."""

    number = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Starts episode `number`, whatever object stands for it in the options."""
        return self.env.reset(seed=seed, options={**(options or {}), "episode": self.number})


def _targets(plan: RecordPlan) -> list[Path]:
    """Returns the files to write; refuses to replace any unless that is wished."""
    targets = [plan.out / f"{NAME}.h5", plan.out / f"{NAME}.json"]
    for target in targets:
        check_file(target, force=plan.force)
    if plan.lerobot:
        targets.append(plan.out / LEROBOT)
        check_folder(targets[-1], force=plan.force, mark=LEROBOT_MARK)
    return targets


def _play(plan: RecordPlan, scratch: Path, told: Told) -> list[EpisodeResult]:
    """Plays the episodes; leaves the two files of those that were solved in `scratch`."""
    use_one_thread()  # as in an evaluation
    config = plan.config
    agent = load_agent(config.agent, environments.setup_of(config))
    source = open_source(
        EpisodeRequest(
            env_id=config.env,
            scene_dataset=config.scene_dataset,
            objects=config.objects,
            split=config.split,
            seed=config.seed,
            novel=config.novel,
        )
    )
    env: Any = environments.make_env(
        config, agent.spec, split=source.split, render=False, num_episodes=plan.most
    )
    recorder = RecordEpisode(
        env,
        str(scratch),
        trajectory_name=NAME,
        save_video=False,
        save_on_reset=False,
        source_desc=f"{agent.spec.name} ({config.agent}), recorded by hab-spa record",
    )
    try:
        results = _play_until(plan, _Numbered(recorder), agent, source, told)
    finally:
        recorder.close()
    numbers = [number for number, result in enumerate(results) if result.success]
    _annotate(scratch / f"{NAME}.json", config.env, [source.get(number) for number in numbers])
    return results


def _play_until(
    plan: RecordPlan, env: _Numbered, agent: Agent, source: EpisodeSource, told: Told
) -> list[EpisodeResult]:
    """Returns how each episode went, in order; keeps the trajectories of those solved."""
    recorder: Any = env.env
    results: list[EpisodeResult] = []
    solved = 0
    for number in range(min(plan.most, source.available)):
        episode, env.number = source.get(number), number
        try:
            result = run_episode(env, agent, number, episode).episode
        except Exception as error:
            raise RunStoppedError(
                f"Episode {episode.id!r} stopped the recording: {type(error).__name__}: {error}",
                details=traceback.format_exc(),
            ) from error
        recorder.flush_trajectory(save=result.success)
        results.append(result)
        told(result)
        solved += result.success
        if solved == plan.config.episodes:
            break
    return results


def _annotate(file: Path, env_id: str, episodes: list[Episode]) -> None:
    """Adds to ManiSkill's file where the environment comes from, and what each episode is about."""
    told = json.loads(file.read_text(encoding="utf-8"))
    told["env_info"]["env_id"] = f"hab_tasks:{env_id}"  # Gymnasium then imports the module itself
    for entry, episode in zip(told["episodes"], episodes, strict=True):
        entry |= {"episode": episode.id, "task": describe_task(env_id, episode)}
    file.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")
