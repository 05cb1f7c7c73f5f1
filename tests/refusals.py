"""Requirements on error messages: one line that names the fault, and no other output."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import pytest

from hab_tasks.errors import HabError

EXIT_BAD_INPUT = 2

Main = Callable[[Sequence[str]], int]
T = TypeVar("T")


def check_each(cases: Mapping[str, T], check: Callable[[T], object]) -> None:
    """Checks every case; asserts that none fails, and names those that do with the reason."""
    found = {name: _reason(check, case) for name, case in cases.items()}
    wrong = [f"{name}: {reason}"[:400] for name, reason in found.items() if reason]
    assert not wrong, "\n".join(wrong)


def _reason(check: Callable[[T], object], case: T) -> str:
    try:
        check(case)
    except (Exception, pytest.fail.Exception) as error:
        return f"{type(error).__name__}: {error}"
    return ""


@dataclass(frozen=True, kw_only=True)
class Refusal:
    """How a command ended."""

    code: int
    out: str
    line: str


def refused_by_command(main: Main, arguments: Sequence[object], *words: str) -> Refusal:
    """Runs a console script in this process; asserts exit 2 and one line that holds all `words`."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = _exit_code(main, [str(argument) for argument in arguments])
    lines = err.getvalue().strip().splitlines()
    assert code == EXIT_BAD_INPUT, (code, out.getvalue(), err.getvalue())
    assert len(lines) == 1, err.getvalue()
    check_words(lines[0], words)
    return Refusal(code=code, out=out.getvalue(), line=lines[0])


def refused_by_call(call: Callable[[], object], *words: str) -> str:
    """Calls `call`; asserts a `HabError` whose message is one line that holds all `words`."""
    with pytest.raises(HabError) as caught:
        call()
    message = str(caught.value)
    assert len(message.splitlines()) == 1, message
    check_words(message, words)
    return message


def check_words(line: str, words: Sequence[str]) -> None:
    """Asserts that a line is short enough to read and holds all `words`."""
    assert len(line) < 1500, line[:2000]
    assert "Traceback" not in line
    for word in words:
        assert word in line, (word, line)


def _exit_code(main: Main, arguments: list[str]) -> int:
    try:
        return main(arguments)
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else 1
