"""How a run reports itself: a bar on a terminal, plain lines in a log."""

from __future__ import annotations

import time
from collections.abc import Callable

from tqdm import tqdm

from hab_eval.evaluate import Reporter
from hab_eval.plain_text import plain
from hab_eval.results import EpisodeResult, FinishedEpisode

GENERATION_LINE_INTERVAL_S = 10.0

WriteLine = Callable[[str], None]


class PlainReporter:
    """Writes one line for each episode; lines survive in a log where a bar does not."""

    def __init__(self, write_line: WriteLine) -> None:
        self._write = write_line
        self._done = 0
        self._total = 0
        self._last_line_s = time.monotonic()

    def generating(self, done: int, total: int) -> None:
        """Writes a line now and then, and at the end."""
        now_s = time.monotonic()
        if done < total and now_s - self._last_line_s < GENERATION_LINE_INTERVAL_S:
            return
        self._last_line_s = now_s
        self._write(f"generated {done} of {total} episodes")

    def running(self, done: int, total: int) -> None:
        """Says how many episodes are ahead."""
        self._done, self._total = done, total
        kept = f", {done} kept from before" if done else ""
        self._write(f"running {total} episodes{kept}")

    def finished(self, finished: FinishedEpisode) -> None:
        """Writes how the episode went."""
        self._done += 1
        self._write(f"[{self._done}/{self._total}] {describe(finished.episode)}")


class BarReporter:
    """Draws a bar for the generation of episodes and one for the run."""

    def __init__(self, write_line: WriteLine | None = None) -> None:
        """Writes a line for each episode above the bar, if given how."""
        self._write = write_line
        self._bar: tqdm | None = None
        self._successes = 0
        self._finished = 0

    def generating(self, done: int, total: int) -> None:
        """Moves the first bar."""
        if self._bar is None:
            self._bar = tqdm(total=total, desc="generating episodes", unit="episode")
        self._bar.update(done - self._bar.n)

    def running(self, done: int, total: int) -> None:
        """Replaces the first bar by the second."""
        self.close()
        self._bar = tqdm(total=total, initial=done, desc="evaluating", unit="episode")

    def finished(self, finished: FinishedEpisode) -> None:
        """Moves the second bar; shows the success rate of this sitting."""
        if self._bar is None:
            return
        self._finished += 1
        self._successes += finished.episode.success
        if self._write is not None:
            self._write(f"[{self._bar.n + 1}/{self._bar.total}] {describe(finished.episode)}")
        self._bar.set_postfix_str(f"{self._successes}/{self._finished} successful")
        self._bar.update()

    def close(self) -> None:
        """Leaves the bar where it is."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


def make_reporter(*, terminal: bool, verbose: bool, write_line: WriteLine) -> Reporter:
    """Returns the reporter that suits the output.

    Args:
        terminal: Whether a bar can be drawn; without one, each episode gets a line.
        verbose: Whether each episode gets a line above the bar as well.
        write_line: How lines are written where there is no bar.
    """
    if not terminal:
        return PlainReporter(write_line)
    return BarReporter(tqdm.write if verbose else None)


def describe(episode: EpisodeResult) -> str:
    """Returns one line on how an episode went."""
    outcome = episode.failure or "success"
    return plain(
        f"{episode.id} ({episode.scene}): {outcome}, {episode.steps} steps, "
        f"return {episode.episode_return:.3f}, {episode.seconds:.1f} s"
    )
