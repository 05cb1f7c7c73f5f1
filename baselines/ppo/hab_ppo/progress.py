"""What a run reports: progress lines, TensorBoard scalars and `progress.jsonl`."""

from __future__ import annotations

import json
import tempfile
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from torch.utils.tensorboard import SummaryWriter

from hab_tasks.io.files import written_aside

WriteLine = Callable[[str], None]

LINE_S = 5.0
"""Least time between two progress lines."""

RECENT_EPISODES = 100
"""Training success and return are means over the updates with the last episodes, this many."""

PARTS = ("env", "inference", "update")
FILE = "progress.jsonl"


class Recent:
    """Means over the last episodes.

    Attributes:
        metrics: ``train/success``, ``train/return``, ``train/length`` and, for each stage of a
            task, the share of the episodes that reached it: ``train/stage/pick_1``.
    """

    def __init__(self, stages: Sequence[str] = ()) -> None:
        self._names = [f"train/{name}" for name in ("success", "return", "length")]
        self._names += [f"train/stage/{name}" for name in stages]
        self._sums: deque[list[float]] = deque()
        self.metrics: dict[str, float] = {}

    def add(self, sums: list[float]) -> None:
        """Adds the sums (episodes, successes, return, length, stages) of an update."""
        self._sums.append(sums)
        while sum(one[0] for one in self._sums) - self._sums[0][0] >= RECENT_EPISODES:
            self._sums.popleft()
        count, *totals = map(sum, zip(*self._sums, strict=True))
        if count:
            pairs = zip(self._names, totals, strict=True)
            self.metrics = {name: total / count for name, total in pairs}


class Progress:
    """Writes the metrics of a run.

    Every update is a line of `progress.jsonl`, from which `hab-ppo plot` draws the curves.
    """

    def __init__(self, folder: Path, write_line: WriteLine, total_steps: int, update: int) -> None:
        """Continues the files of a run after `update` updates; later ones are dropped."""
        self._write_line, self._total = write_line, total_steps
        kept = [entry for entry in read_progress(folder) if entry["update"] <= update]
        with written_aside(folder / FILE) as scratch:  # a kill keeps the earlier lines
            scratch.write_text("".join(map(_as_line, kept)), encoding="utf-8")
        self._file = (folder / FILE).open("a", encoding="utf-8")
        first = kept[-1]["steps"] + 1 if kept else 0
        self._board = _Board(folder / "tensorboard", first, write_line)
        self._said_s = float("-inf")

    def add(self, update: int, steps: int, seconds: float, metrics: Mapping[str, float]) -> None:
        """Records the metrics of an update, after `steps` steps and `seconds` in all."""
        entry = {"update": update, "steps": steps, "seconds": round(seconds, 2), **metrics}
        self._keep(entry)
        self._board.add(metrics, steps)
        if seconds - self._said_s >= LINE_S:
            self._said_s = seconds
            self._write_line(self._line(entry))

    def begin(self, seconds: float, metrics: Mapping[str, float]) -> None:
        """Records the evaluation of the policy from which a run starts."""
        self._keep({"update": 0, "steps": 0, "seconds": round(seconds, 2), **metrics})
        self._board.add(metrics, 0)
        self._write_line(f"PPO starts from a policy with success {metrics['eval/success']:.0%}")

    def say(self, text: str) -> None:
        """Writes a line at once."""
        self._write_line(text)

    def close(self) -> None:
        """Closes the files."""
        self._file.close()
        self._board.close()

    def _keep(self, entry: Mapping[str, Any]) -> None:
        self._file.write(_as_line(entry))
        self._file.flush()

    def _line(self, entry: Mapping[str, Any]) -> str:
        """Returns the progress line of an update."""
        speed = entry["time/steps_per_s"]
        left_steps = max(0, self._total - entry["steps"])
        left_min = left_steps * entry["seconds"] / max(1, entry["steps"]) / 60
        shares = " ".join(f"{part} {entry[f'time/{part}']:.0%}" for part in PARTS)
        words = [f"{entry['steps']:,} of {self._total:,} steps", f"{speed:,.0f}/s", shares]
        if "train/return" in entry:
            words.append(f"return {entry['train/return']:.2f}")
            words.append(f"success {entry['train/success']:.0%}")
        if "eval/success" in entry:
            words.append(f"evaluated {entry['eval/success']:.0%} (best {entry['eval/best']:.0%})")
        return " | ".join([*words, f"{left_min:.0f} min left"])


class _Board:
    """TensorBoard files, as long as they can be written: a run does not end for want of them."""

    def __init__(self, folder: Path, first_step: int, write_line: WriteLine) -> None:
        """Continues the files before `first_step`; later scalars are dropped."""
        self._folder, self._write_line = folder, write_line
        self._writer: SummaryWriter | None = None
        with self._tried():
            folder.mkdir(exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):  # the writer's thread would print a traceback
                self._writer = SummaryWriter(str(folder), purge_step=first_step)

    def add(self, scalars: Mapping[str, float], step: int) -> None:
        """Adds scalars."""
        with self._tried():
            for name, value in scalars.items():
                if self._writer is not None:
                    self._writer.add_scalar(name, value, step)

    def close(self) -> None:
        """Closes the files."""
        with self._tried():
            if self._writer is not None:
                self._writer.close()

    @contextmanager
    def _tried(self) -> Iterator[None]:
        """Gives up after an error, with a line."""
        try:
            yield
        except OSError as error:
            self._writer = None
            reason = error.strerror or error
            self._write_line(
                f"{self._folder} cannot be written ({reason}); the run goes on without TensorBoard "
                f"files, and {FILE} has the same numbers."
            )


def read_progress(folder: Path) -> list[dict[str, Any]]:
    """Returns the entries of a run's `progress.jsonl`; a line cut off by a kill is left out."""
    path = folder / FILE
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    if lines and not _is_whole(lines[-1]):
        lines.pop()
    return [json.loads(line) for line in lines]


def _as_line(entry: Mapping[str, Any]) -> str:
    return json.dumps(entry) + "\n"


def _is_whole(line: str) -> bool:
    try:
        json.loads(line)
    except ValueError:
        return False
    return True
