"""Progress of commands: a bar on a terminal, plain lines in logs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tqdm import tqdm

LINE_INTERVAL_S = 10.0


class GenerationLines:
    """Writes a line every `LINE_INTERVAL_S`, and at the end."""

    def __init__(self, write_line: Callable[[str], None]) -> None:
        self._write = write_line
        self._last_line_s = time.monotonic()

    def show(self, done: int, total: int) -> None:
        """Writes a line, if one is due."""
        now_s = time.monotonic()
        if done < total and now_s - self._last_line_s < LINE_INTERVAL_S:
            return
        self._last_line_s = now_s
        self._write(f"generated {done} of {total} episodes")


@contextmanager
def progress_bar(
    unit: str, line: Callable[[int, int], None] | None = None
) -> Iterator[Callable[[int, int], None]]:
    """Yields a function that shows (done, all): a bar on a terminal, elsewhere it calls `line`."""
    with tqdm(unit=unit, disable=None) as bar:

        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)
            if bar.disable and line is not None:
                line(done, total)

        yield show
