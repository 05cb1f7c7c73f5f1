"""Progress of episode generation as plain lines, for logs."""

from __future__ import annotations

import time
from collections.abc import Callable

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
