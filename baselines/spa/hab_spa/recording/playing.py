"""Plays the episodes of a recording: in this process, in workers, or on a Ray cluster.

Trajectories are taken in the order of the episodes, so a recording does not depend on the workers.
Workers are ahead by a few episodes, which are dropped at the end.
"""

from __future__ import annotations

import io
import json
import tempfile
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium as gym
import h5py
from hab_eval.records.results import EpisodeResult
from hab_eval.run import environments
from hab_eval.run.agents import load_agent
from hab_eval.run.runner import run_episode
from mani_skill.utils.wrappers.record import RecordEpisode

from hab_spa.recording.frames import FrameRecorder, Seen
from hab_spa.recording.plan import NAME, RecordPlan
from hab_tasks.engine.rollout import Job
from hab_tasks.episodes import open_source
from hab_tasks.errors import RunStoppedError
from hab_tasks.io.executors import Task, open_executor
from hab_tasks.io.files import make_scratch_folder
from hab_tasks.io.pool import in_order
from hab_tasks.io.threads import use_one_thread

TRAJECTORY = "trajectory"
"""Name of the only group of a played episode's HDF5 file."""


@dataclass(frozen=True, kw_only=True)
class Played:
    """A played episode.

    Attributes:
        result: Its result.
        seen: What was seen and told in it; None if it failed, and the rest is empty.
        description: ManiSkill's JSON with this episode alone.
        trajectory: HDF5 file with the group `TRAJECTORY`.
        images: Files of images, by name; see `hab_spa.recording.frames`.
    """

    result: EpisodeResult
    seen: Seen | None = None
    description: dict[str, Any] = field(default_factory=dict)
    trajectory: bytes = b""
    images: dict[str, bytes] = field(default_factory=dict)


@contextmanager
def played_episodes(plan: RecordPlan, scratch: Path) -> Iterator[Iterator[Played]]:
    """Yields the played episodes in order; workers of this machine put their files in `scratch`."""
    source = open_source(environments.request_of(plan.config))
    numbers = range(min(plan.most, source.available))
    with open_executor(plan.executor, plan.workers) as executor:
        if executor.in_process(len(numbers)):
            with closing(Player(plan, scratch)) as player:
                yield map(player.play, numbers)
            return
        # A worker on another machine has no access to this one's folders.
        folder = None if plan.executor.is_remote else scratch
        task = Task(start=_start_player, arguments=(plan, folder), name="Episode {}".format)
        with closing(executor.run(task, numbers)) as answers:
            yield in_order(answers)


def _start_player(plan: RecordPlan, folder: Path | None) -> Callable[[int], Played]:
    # The next recording on this node removes the folder of a worker that was killed.
    return Player(plan, folder or Path(tempfile.gettempdir())).play


class Player:
    """Plays episodes by number."""

    def __init__(self, plan: RecordPlan, folder: Path) -> None:
        """Creates agent and environment; files of the current episode are in `folder`."""
        use_one_thread()  # as in an evaluation
        config, self._folder = plan.config, make_scratch_folder(folder)
        self._agent = load_agent(config.agent, environments.setup_of(config))
        self._source = open_source(environments.request_of(config))
        spec = self._agent.spec
        env: Any = environments.make_env(
            config,
            spec if plan.views is None else plan.views.added_to(spec),
            split=self._source.split,
            render=False,
            num_episodes=plan.most,
        )
        self._frames = FrameRecorder(env, self._folder / "images", looks=plan.views is not None)
        self._recorder = RecordEpisode(
            env,
            str(self._folder),
            trajectory_name=NAME,
            save_video=False,
            save_on_reset=False,
            clean_on_close=False,  # trajectories are taken out of its file
            source_desc=f"{spec.name} ({config.agent}), recorded by hab-spa record",
        )
        self._solved = 0

    def play(self, number: int) -> Played:
        """Plays an episode.

        Raises:
            RunStoppedError: The agent or the environment raised.
        """
        episode, recorder = self._source.get(number), self._recorder
        try:
            result = run_episode(
                recorder, self._agent, number, episode, [self._frames], restart=_numbered
            ).episode
        except Exception as error:
            raise RunStoppedError(
                f"Episode {episode.id!r} stopped the recording: {type(error).__name__}: "
                f"{str(error).rstrip('.')}. Nothing was written; --verbose shows the traceback.",
                details=traceback.format_exc(),
            ) from error
        recorder.flush_trajectory(save=result.success)
        if not result.success:
            return Played(result=result)
        description = json.loads((self._folder / f"{NAME}.json").read_text(encoding="utf-8"))
        seen = self._frames.seen()
        told = {"episode": episode.id, "task": seen.task, "stages": seen.stages}
        description["episodes"] = [description["episodes"][-1] | told]
        self._solved += 1
        return Played(
            result=result,
            seen=seen,
            description=description,
            trajectory=_taken(self._folder / f"{NAME}.h5", f"traj_{self._solved - 1}"),
            images=self._frames.images(),
        )

    def close(self) -> None:
        """Frees the simulator."""
        self._recorder.close()


def _numbered(env: gym.Env[Any, Any], job: Job) -> tuple[Any, dict[str, Any]]:
    """Starts an episode by its index, which can be stored in a file and replayed."""
    return env.reset(seed=job.episode.seed, options={"episode": job.index, "reconfigure": True})


def _taken(file: Path, name: str) -> bytes:
    """Returns a trajectory of a file that the recorder has open, and removes it there."""
    buffer = io.BytesIO()
    with h5py.File(file, "r+") as source, h5py.File(buffer, "w") as target:
        source.copy(name, target, TRAJECTORY)
        del source[name]
    return buffer.getvalue()


def until_enough(plan: RecordPlan, played: Iterable[Played]) -> Iterator[Played]:
    """Yields episodes up to the one that completes the demonstrations."""
    solved = 0
    for one in played:
        yield one
        solved += one.result.success
        if solved == plan.config.episodes:
            return
