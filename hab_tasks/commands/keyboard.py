"""Moves the robot by keys of the terminal: one key, one action, and more while a key is held.

A terminal tells that a key was pressed, and again and again after a delay of half a second while it
is held, but not that it was let go. `HeldKey` bridges that delay.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from hab_tasks.constants import CONTROL_HZ
from hab_tasks.errors import HabError
from hab_tasks.robots.control_modes import ARM_SIZE, BASE_CELLS

if TYPE_CHECKING:
    from hab_tasks.robots.control import HabController

WAIT_S = 0.05
"""While nothing is typed, a window is drawn anew this often."""

FIRST_REPEAT_S = 0.7
"""Terminals repeat a key that is held after 0.25 to 0.66 s."""

NEXT_REPEAT_S = 0.15
"""... and from then on every 0.03 to 0.1 s."""

CAREFUL_SHARE = 0.25
"""Share of the full speed until a key is known to be held, so that a tap moves little: the hand by
8 cm, the base by 17 cm."""

QUIT, WAIT, GRIP = "q", "space", "g"


@dataclass(frozen=True, kw_only=True)
class Key:
    """A key that moves something.

    Attributes:
        name: The key.
        part: ``arm`` or ``base``.
        entry: Which entry of that part's action it sets.
        value: What to.
        meaning: One line for the table.
    """

    name: str
    part: str
    entry: int
    value: float
    meaning: str


KEYS = {
    key.name: key
    for key in (
        Key(name="w", part="base", entry=0, value=1.0, meaning="drive ahead"),
        Key(name="s", part="base", entry=0, value=-0.5, meaning="drive back"),
        Key(name="a", part="base", entry=1, value=1.0, meaning="turn left"),
        Key(name="d", part="base", entry=1, value=-1.0, meaning="turn right"),
        Key(name="up", part="arm", entry=0, value=1.0, meaning="hand ahead"),
        Key(name="down", part="arm", entry=0, value=-1.0, meaning="hand back"),
        Key(name="left", part="arm", entry=1, value=1.0, meaning="hand to the left"),
        Key(name="right", part="arm", entry=1, value=-1.0, meaning="hand to the right"),
        Key(name="r", part="arm", entry=2, value=1.0, meaning="hand up"),
        Key(name="f", part="arm", entry=2, value=-1.0, meaning="hand down"),
    )
}

OTHER_KEYS = {
    GRIP: "grasp what is within 15 cm of the hand, or let go",
    WAIT: "do nothing; in Navigate, stop",
    QUIT: "quit",
}

_ESCAPED = {"[A": "up", "[B": "down", "[C": "right", "[D": "left"}


def key_table(arm: bool = True, base: bool = True) -> str:
    """Returns a line for each key, of the parts that can be moved."""
    moved = [part for part, there in (("arm", arm), ("base", base)) if there]
    lines = {key.name: key.meaning for key in KEYS.values() if key.part in moved}
    lines |= {name: words for name, words in OTHER_KEYS.items() if arm or name != GRIP}
    return "\n".join(f"  {name:<6} {words}" for name, words in lines.items())


class Keyboard:
    """Turns keys into actions of the control mode that is set."""

    def __init__(self, controller: HabController, holding: bool) -> None:
        """Starts with the hand closed if it is `holding` something."""
        self._controller = controller
        self._grips = holding
        config = controller.config
        self.moves_arm, self.moves_base = config.arm == "ee", config.base != "still"

    @property
    def table(self) -> str:
        """A line for each key that does something."""
        return key_table(arm=self.moves_arm, base=self.moves_base)

    def action(self, name: str, share: float = 1.0) -> Any | None:
        """Returns the action (A,) of a key, or a cell; None where the key does nothing here.

        Args:
            name: The key.
            share: Share of the full speed; cells have one speed.
        """
        key = KEYS.get(name)
        if name == GRIP and self.moves_arm:
            self._grips = not self._grips
        elif name != WAIT and (key is None or not self._moves(key.part)):
            return None
        if self._controller.config.base == "discrete":
            wanted = [0.0, 0.0]
            if key is not None:
                wanted[key.entry] = key.value
            return BASE_CELLS.index((wanted[0], wanted[1]))
        action = np.zeros(self._controller.config.size, dtype=np.float32)
        if self.moves_arm:
            action[ARM_SIZE["ee"]] = 1.0 if self._grips else -1.0
        if key is not None:
            action[key.entry - (2 if key.part == "base" else 0)] = share * key.value
        return action

    def _moves(self, part: str) -> bool:
        return self.moves_arm if part == "arm" else self.moves_base


class HeldKey:
    """Which key is held, as far as its repetitions tell."""

    def __init__(self) -> None:
        self._name, self._until_s, self._repeated = "", 0.0, False

    def press(self, name: str, now_s: float) -> None:
        """Takes a key that was typed at a time."""
        self._repeated = name == self._name and now_s < self._until_s
        self._name = name
        self._until_s = now_s + (NEXT_REPEAT_S if self._repeated else FIRST_REPEAT_S)

    def held(self, now_s: float) -> tuple[str, float] | None:
        """Returns the key and the share of the full speed; None when no key moves anything."""
        if self._name not in KEYS or now_s >= self._until_s:
            return None
        return self._name, 1.0 if self._repeated else CAREFUL_SHARE


def keys_of(stream: TextIO, while_waiting: Callable[[], None]) -> Iterator[tuple[str, float]]:
    """Yields a key and the share of its full speed for every action.

    Args:
        stream: A terminal, where a key that is held is yielded as often as it is asked for, or
            anything else, each of whose characters is one action at full speed.
        while_waiting: Called now and then while no key is held.
    """
    if stream.isatty():
        return _terminal(stream, while_waiting)
    return ((name, 1.0) for name in _named(iter(lambda: stream.read(1), "")))


def _terminal(stream: TextIO, while_waiting: Callable[[], None]) -> Iterator[tuple[str, float]]:
    """Yields keys as they are typed, without waiting for the end of a line, and held ones."""
    if sys.platform == "win32":
        raise HabError("--agent keyboard reads a POSIX terminal; on Windows, type into a pipe.")
    import select
    import termios
    import tty

    terminal = stream.fileno()
    before = termios.tcgetattr(terminal)
    try:
        tty.setcbreak(terminal)
        key, escaped, due_s = HeldKey(), "", 0.0
        while True:
            now_s = time.monotonic()
            held = key.held(now_s)
            wait_s = max(due_s - now_s, 0.0) if held else WAIT_S
            if not select.select([terminal], [], [], wait_s)[0]:
                if held:
                    due_s = time.monotonic() + 1.0 / CONTROL_HZ
                    yield held
                else:
                    while_waiting()
                continue
            data = os.read(terminal, 64)
            if not data:
                return
            escaped += data.decode(errors="ignore")
            for name in _named(escaped):
                key.press(name, time.monotonic())
                if name not in KEYS:
                    yield name, 1.0
            escaped = _unfinished(escaped)
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def _unfinished(typed: str) -> str:
    """Returns the begun arrow key at the end of what was typed, "" if there is none."""
    start = typed.rfind("\x1b")
    return typed[start:] if 0 <= start > len(typed) - 3 else ""


def _named(characters: Iterable[str]) -> Iterator[str]:
    """Yields names of keys; arrows come as three characters, line ends mean nothing."""
    escaped = ""
    for character in characters:
        if escaped or character == "\x1b":
            escaped += character
            if len(escaped) == 3:
                yield _ESCAPED.get(escaped[1:], "escape")
                escaped = ""
        elif character not in "\r\n":
            yield WAIT if character == " " else character
