"""Progress reports: a bar on a terminal, plain lines in a log."""

from __future__ import annotations

from collections.abc import Callable

from tqdm import tqdm

from hab_eval.records.plain_text import plain
from hab_eval.records.results import EpisodeResult, FinishedEpisode
from hab_eval.run.evaluate import Reporter
from hab_tasks.io.console import GenerationLines

WriteLine = Callable[[str], None]


class PlainReporter:
    """Writes one line per episode, for logs."""

    def __init__(self, write_line: WriteLine) -> None:
        self._write = write_line
        self._done = 0
        self._total = 0
        self._lines = GenerationLines(write_line)

    def generating(self, done: int, total: int) -> None:
        """Writes a line at intervals, and at the end."""
        self._lines.show(done, total)

    def running(self, done: int, total: int) -> None:
        """Writes the number of episodes."""
        self._done, self._total = done, total
        kept = f", {done} already finished" if done else ""
        self._write(f"running {total} episodes{kept}")

    def finished(self, finished: FinishedEpisode) -> None:
        """Writes the result of the episode."""
        self._done += 1
        self._write(f"[{self._done}/{self._total}] {describe(finished.episode)}")


class BarReporter:
    """Shows one progress bar for episode generation and one for the run."""

    def __init__(self, write_line: WriteLine | None = None) -> None:
        """Also writes a line per episode above the bar, if `write_line` is given."""
        self._write = write_line
        self._bar: tqdm | None = None
        self._successes = 0
        self._finished = 0

    def generating(self, done: int, total: int) -> None:
        """Updates the first bar."""
        if self._bar is None:
            self._bar = tqdm(total=total, desc="generating episodes", unit="episode")
        self._bar.update(done - self._bar.n)

    def running(self, done: int, total: int) -> None:
        """Replaces the first bar with the second."""
        self.close()
        self._bar = tqdm(total=total, initial=done, desc="evaluating", unit="episode")

    def finished(self, finished: FinishedEpisode) -> None:
        """Updates the second bar and the success count of this session."""
        if self._bar is None:
            return
        self._finished += 1
        self._successes += finished.episode.success
        if self._write is not None:
            self._write(f"[{self._bar.n + 1}/{self._bar.total}] {describe(finished.episode)}")
        self._bar.set_postfix_str(f"{self._successes}/{self._finished} successful")
        self._bar.update()

    def close(self) -> None:
        """Closes the bar."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


def make_reporter(*, terminal: bool, verbose: bool, write_line: WriteLine) -> Reporter:
    """Returns the reporter for the kind of output.

    Args:
        terminal: Whether the output is a terminal; if not, each episode gets a line.
        verbose: Whether to write a line per episode above the bar as well.
        write_line: Writes a line if there is no bar.
    """
    if not terminal:
        return PlainReporter(write_line)
    return BarReporter(tqdm.write if verbose else None)


def describe(episode: EpisodeResult) -> str:
    """Returns the result of an episode as one line."""
    outcome = episode.failure or "success"
    return plain(
        f"{episode.id} ({episode.scene}): {outcome}, {episode.steps} steps, "
        f"return {episode.episode_return:.3f}, {episode.seconds:.1f} s"
    )
