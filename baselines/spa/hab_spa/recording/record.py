"""Recording of an agent's successful episodes as ManiSkill trajectories.

ManiSkill's own wrapper writes `trajectory.h5` and `trajectory.json`, and its replay tool replays
them. Resets identify the episode by its index in the set given by the environment's arguments, so
that the start state is reproducible on any machine.
"""

from __future__ import annotations

import io
import json
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
from hab_eval.records.results import EpisodeResult
from hab_eval.run import environments

from hab_spa.cli import RecordCommand
from hab_spa.recording.frames import Seen
from hab_spa.recording.plan import LEROBOT, NAME, RecordPlan, Views
from hab_spa.recording.playing import TRAJECTORY, Played, played_episodes, until_enough
from hab_tasks.envs import ENVS
from hab_tasks.io.console import tell
from hab_tasks.io.executors import ExecutorChoice
from hab_tasks.io.files import check_file, check_folder, replace_folder, scratch_folder
from hab_tasks.registration import imported_id, reference_of

EXIT_TOO_FEW = 1

MOST_FOR_EACH = 10
"""Default maximum number of episodes per demonstration."""

LEROBOT_MARK = "meta/info.json"


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
        config=options.config_of(options.count, instructions=options.instructions),
        out=options.out,
        most=most,
        lerobot=options.lerobot,
        targets=options.targets,
        views=_views(options),
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


def _views(options: RecordCommand) -> Views | None:
    if options.obs_mode is None:
        return None
    cameras = None if options.cameras is None else tuple(options.cameras.split(","))
    return Views(obs_mode=options.obs_mode, cameras=cameras, size_px=options.camera_size)


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
        from hab_spa.recording.lerobot_format import write_dataset
    results = []
    with scratch_folder(plan.out) as scratch:
        with (
            played_episodes(plan, scratch) as played,
            closing(_Writer(plan.config.env, scratch)) as writer,
        ):
            for one in until_enough(plan, played):
                results.append(one.result)
                on_episode(one.result)
                writer.write(one)
        if not writer.seen:
            targets = []
        elif plan.lerobot:
            robot = ENVS[imported_id(plan.config.env)].env.robot
            told = plan.targets == "positions"
            write_dataset(scratch / f"{NAME}.h5", scratch / LEROBOT, robot, writer.seen, told)
        for target in targets:
            written = scratch / target.name
            if written.is_dir():
                replace_folder(written, target)
            else:
                written.replace(target)
    return Recorded(
        demonstrations=len(writer.seen),
        episodes=len(results),
        failures=Counter(str(result.failure) for result in results if not result.success),
        files=tuple(targets),
    )


def _targets(plan: RecordPlan) -> list[Path]:
    """Returns the files to write; raises if one exists and `plan.force` is not set."""
    targets = [plan.out / f"{NAME}.h5", plan.out / f"{NAME}.json"]
    for target in targets:
        check_file(target, force=plan.force)
    if plan.lerobot:
        targets.append(plan.out / LEROBOT)
        check_folder(targets[-1], force=plan.force, mark=LEROBOT_MARK)
    return targets


class _Writer:
    """Writes ManiSkill's two files, and the images of episode N to the folder ``traj_N``.

    Attributes:
        seen: What was seen and told in the written episodes.
    """

    def __init__(self, env_id: str, folder: Path) -> None:
        self._env_id, self._folder = env_id, folder
        self._file = h5py.File(folder / f"{NAME}.h5", "w")
        self._description: dict[str, Any] = {}
        self.seen: list[Seen] = []

    def write(self, played: Played) -> None:
        """Appends a successful episode; ignores others."""
        if played.seen is None:
            return
        name = f"traj_{len(self.seen)}"
        with h5py.File(io.BytesIO(played.trajectory)) as source:
            source.copy(TRAJECTORY, self._file, name)
        (entry,) = played.description["episodes"]
        self._description = self._description or {**played.description, "episodes": []}
        self._description["episodes"].append({**entry, "episode_id": len(self.seen)})
        self.seen.append(played.seen)
        (self._folder / name).mkdir()
        for file, content in played.images.items():
            (self._folder / name / file).write_bytes(content)

    def close(self) -> None:
        """Completes the files."""
        self._file.close()
        if self.seen:
            # With the module in the id, Gymnasium imports it itself.
            self._description["env_info"]["env_id"] = reference_of(imported_id(self._env_id))
        text = json.dumps(self._description, indent=2) + "\n"
        (self._folder / f"{NAME}.json").write_text(text, encoding="utf-8")
