"""Recording on a Ray cluster: workers play episodes, and this process collects their trajectories.

Trajectories are taken in the order of the episodes, so the recording has the same content as one
of a single process. Workers are ahead by a few episodes, which are dropped at the end.
"""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
from hab_eval.records.results import EpisodeResult

from hab_spa.recording.record import NAME, OnEpisode, Player, RecordPlan, annotate, play_until
from hab_tasks.episodes import Episode
from hab_tasks.io.executors import Task, open_executor
from hab_tasks.io.files import make_scratch_folder


@dataclass(frozen=True, kw_only=True)
class _Played:
    """An episode that a worker has played.

    Attributes:
        result: Its result.
        episode: Its start; None if it failed, like the rest.
        trajectory: HDF5 file with one group.
        description: ManiSkill's JSON with this episode alone.
    """

    result: EpisodeResult
    episode: Episode | None = None
    trajectory: bytes = b""
    description: dict[str, Any] | None = None


def play_distributed(plan: RecordPlan, scratch: Path, on_episode: OnEpisode) -> list[EpisodeResult]:
    """Runs the episodes on Ray; writes the two files of the successful ones to `scratch`."""
    task = Task(start=_start_player, arguments=(plan,), name="Episode {}".format)
    episodes: list[Episode] = []
    with (
        open_executor(plan.executor, plan.workers) as executor,
        closing(executor.run(task, range(plan.most))) as answers,
        closing(_written(_in_order(answers), scratch, episodes)) as results,
    ):
        found = play_until(plan, results, on_episode)
    if episodes:
        annotate(scratch / f"{NAME}.json", plan.config.env, episodes)
    return found


def _in_order(answers: Iterable[tuple[int, _Played]]) -> Iterator[_Played]:
    """Yields results in the order of the episodes."""
    waiting: dict[int, _Played] = {}
    due = 0
    for number, played in answers:
        waiting[number] = played
        while due in waiting:
            yield waiting.pop(due)
            due += 1


def _written(
    played: Iterable[_Played], scratch: Path, episodes: list[Episode]
) -> Generator[EpisodeResult, None, None]:
    """Yields the results; writes the trajectories, and adds their `episodes`."""
    description: dict[str, Any] = {}
    with h5py.File(scratch / f"{NAME}.h5", "w") as file:
        try:
            for one in played:
                if one.episode is not None and one.description is not None:
                    with h5py.File(io.BytesIO(one.trajectory)) as source:
                        source.copy("trajectory", file, f"traj_{len(episodes)}")
                    (entry,) = one.description["episodes"]
                    description = description or {**one.description, "episodes": []}
                    description["episodes"].append({**entry, "episode_id": len(episodes)})
                    episodes.append(one.episode)
                yield one.result
        finally:
            text = json.dumps(description, indent=2)
            (scratch / f"{NAME}.json").write_text(text, encoding="utf-8")


def _start_player(plan: RecordPlan) -> Callable[[int], _Played]:
    # The next recording on this node removes the folder of a worker that was killed.
    folder = make_scratch_folder(Path(tempfile.gettempdir()))
    player = Player(plan, folder)
    solved = 0

    def play(number: int) -> _Played:
        nonlocal solved
        result = player.play(number)
        if not result.success:
            return _Played(result=result)
        description = json.loads((folder / f"{NAME}.json").read_text(encoding="utf-8"))
        description["episodes"] = description["episodes"][-1:]
        trajectory = _taken(folder / f"{NAME}.h5", f"traj_{solved}")
        solved += 1
        return _Played(
            result=result,
            episode=player.source.get(number),
            trajectory=trajectory,
            description=description,
        )

    return play


def _taken(file: Path, name: str) -> bytes:
    """Returns a trajectory of a file that the recorder has open, and removes it there."""
    buffer = io.BytesIO()
    with h5py.File(file, "r+") as source, h5py.File(buffer, "w") as target:
        source.copy(name, target, "trajectory")
        del source[name]
    return buffer.getvalue()
