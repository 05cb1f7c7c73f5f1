"""Keyboard control from terminal or browser: one action per key press, repeated while it is held.

Both report a key press, and repeat it after a delay of half a second while the key is held,
but do not report the release. `HeldKey` bridges that delay.
"""

from __future__ import annotations

import os
import select
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from hab_tasks.constants import CONTROL_HZ
from hab_tasks.errors import HabError
from hab_tasks.robots.control_modes import BASE_CELLS

if sys.platform != "win32":  # they are POSIX's
    import termios
    import tty

if TYPE_CHECKING:
    from hab_tasks.robots.control import HabController

WAIT_S = 0.05
"""Redraw interval of the window while no key is pressed."""

FIRST_REPEAT_S = 0.7
"""Timeout until the first repeat of a held key; terminals take 0.25 to 0.66 s."""

NEXT_REPEAT_S = 0.15
"""Timeout between further repeats; terminals take 0.03 to 0.1 s."""

CAREFUL_SHARE = 0.25
"""Share of full speed until a key counts as held, to keep a tap's motion small: 8 cm of the hand,
17 cm of the base."""

QUIT, WAIT, GRIP = "q", "space", "g"


@dataclass(frozen=True, kw_only=True)
class Key:
    """A key that sets an entry of the action of a part, ``arm`` or ``base``."""

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

BROWSER_KEYS = {
    **{"w": "I", "s": "K", "a": "J", "d": "L", "r": "R", "f": "F"},
    **{"up": "8", "down": "2", "left": "4", "right": "6", GRIP: "G", WAIT: "5"},
}
"""Keys in the browser, where W, A, S, D, Q, E and the arrows move the camera."""

_ESCAPED = {"[A": "up", "[B": "down", "[C": "right", "[D": "left"}


def meanings(arm: bool = True, base: bool = True) -> dict[str, str]:
    """Returns what each key does, for the enabled parts."""
    moved = [part for part, there in (("arm", arm), ("base", base)) if there]
    lines = {key.name: key.meaning for key in KEYS.values() if key.part in moved}
    return lines | {name: words for name, words in OTHER_KEYS.items() if arm or name != GRIP}


def key_table(lines: Mapping[str, str]) -> str:
    """Returns a line per key."""
    return "\n".join(f"  {name:<6} {words}" for name, words in lines.items())


class Keyboard:
    """Converts keys to actions of the current control mode."""

    def __init__(self, controller: HabController, holding: bool) -> None:
        """Starts with the gripper closed if `holding` an object or handle."""
        self._controller = controller
        self._grips = holding
        config = controller.config
        self.moves_arm, self.moves_base = config.arm == "ee", config.base != "still"

    @property
    def meanings(self) -> dict[str, str]:
        """What each active key does."""
        return meanings(arm=self.moves_arm, base=self.moves_base)

    def action(self, name: str, share: float = 1.0) -> Any | None:
        """Returns the action (A,) or the discrete cell of a key; None for an inactive key.

        `share` is that of full speed; it is ignored for cells.
        """
        key, moved = KEYS.get(name), {"arm": self.moves_arm, "base": self.moves_base}
        if name == GRIP and self.moves_arm:
            self._grips = not self._grips
        elif name != WAIT and (key is None or not moved[key.part]):
            return None
        if self._controller.config.base == "discrete":
            wanted = [0.0, 0.0]
            if key is not None:
                wanted[key.entry] = key.value
            return BASE_CELLS.index((wanted[0], wanted[1]))
        action = np.zeros(self._controller.config.size, dtype=np.float32)
        if self.moves_arm:
            action[self._controller.config.arm_size] = 1.0 if self._grips else -1.0
        if key is not None:
            action[key.entry - (2 if key.part == "base" else 0)] = share * key.value
        return action


class HeldKey:
    """Infers from key repeats which key is held."""

    def __init__(self) -> None:
        self._name, self._until_s, self._repeated = "", 0.0, False

    def press(self, name: str, now_s: float) -> None:
        """Records a key press at a time."""
        self._repeated = name == self._name and now_s < self._until_s
        self._name = name
        self._until_s = now_s + (NEXT_REPEAT_S if self._repeated else FIRST_REPEAT_S)

    def held(self, now_s: float) -> tuple[str, float] | None:
        """Returns the held key and its share of full speed; None if no key is held."""
        if self._name not in KEYS or now_s >= self._until_s:
            return None
        return self._name, 1.0 if self._repeated else CAREFUL_SHARE


def keys_of(stream: TextIO, while_waiting: Callable[[], None]) -> Iterator[tuple[str, float]]:
    """Yields the key and its share of full speed for every action.

    In a terminal, a held key is yielded on every iteration; of any other stream, each character is
    one action at full speed. `while_waiting` is called at intervals while no key is held.
    """
    if stream.isatty():
        return _terminal(stream, while_waiting)
    return ((name, 1.0) for name in _named(iter(lambda: stream.read(1), "")))


def held_keys(
    read: Callable[[float], Iterable[str] | None], while_waiting: Callable[[], None]
) -> Iterator[tuple[str, float]]:
    """Yields pressed and held keys.

    Args:
        read: Waits for at most so many seconds; returns the keys pressed since, or None at the end.
        while_waiting: Called at intervals while no key is held.
    """
    key, due_s = HeldKey(), 0.0
    while True:
        now_s = time.monotonic()
        held = key.held(now_s)
        names = read(max(due_s - now_s, 0.0) if held else WAIT_S)
        if names is None:
            return
        pressed = list(names)
        for name in pressed:
            key.press(name, time.monotonic())
            if name not in KEYS:
                yield name, 1.0
        if held and not pressed:
            due_s = time.monotonic() + 1.0 / CONTROL_HZ
            yield held
        elif not pressed:
            while_waiting()


def _terminal(stream: TextIO, while_waiting: Callable[[], None]) -> Iterator[tuple[str, float]]:
    """Yields pressed and held keys, without waiting for the end of a line."""
    if sys.platform == "win32":
        raise HabError("--agent keyboard reads a POSIX terminal; on Windows, type into a pipe.")
    terminal = stream.fileno()
    before = termios.tcgetattr(terminal)
    escaped = ""

    def read(wait_s: float) -> Iterable[str] | None:
        nonlocal escaped
        if not select.select([terminal], [], [], wait_s)[0]:
            return ()
        data = os.read(terminal, 64)
        if not data:
            return None
        escaped += data.decode(errors="ignore")
        names, escaped = list(_named(escaped)), _unfinished(escaped)
        return names

    try:
        tty.setcbreak(terminal)
        yield from held_keys(read, while_waiting)
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def _unfinished(typed: str) -> str:
    """Returns the incomplete escape sequence at the end of the input, or ""."""
    start = typed.rfind("\x1b")
    return typed[start:] if 0 <= start > len(typed) - 3 else ""


def _named(characters: Iterable[str]) -> Iterator[str]:
    """Yields names of keys; arrow keys are three characters, line ends are skipped."""
    escaped = ""
    for character in characters:
        if escaped or character == "\x1b":
            escaped += character
            if len(escaped) == 3:
                yield _ESCAPED.get(escaped[1:], "escape")
                escaped = ""
        elif character not in "\r\n":
            yield WAIT if character == " " else character
