"""Fixtures of the evaluator's tests: a stub environment, so that no simulator is needed."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(HERE))  # so that stub_hab has one name here and in worker processes

import stub_hab  # noqa: E402
import stub_runs  # noqa: E402
from hab_eval.cli import main  # noqa: E402

Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def stubbed() -> Iterator[None]:
    """Replaces the environments by the stub's, in this process."""
    undo = stub_hab.install()
    yield
    undo()


@pytest.fixture
def start_cli() -> Callable[..., subprocess.Popen[str]]:
    """Starts `hab-eval` on the stub in a process group of its own."""
    return stub_runs.start


@pytest.fixture
def wait_for_episodes() -> Callable[[subprocess.Popen[str], Path, int], None]:
    """Waits until a run has finished a number of episodes."""

    def wait(process: subprocess.Popen[str], out: Path, count: int) -> None:
        journal, deadline_s = out / "episodes.jsonl", time.monotonic() + 120
        while time.monotonic() < deadline_s and process.poll() is None:
            if journal.is_file() and len(journal.read_text().splitlines()) >= count:
                return
            time.sleep(0.02)
        pytest.fail(f"no {count} episodes: {process.communicate(timeout=5)}")

    return wait


@pytest.fixture
def cli_process(start_cli: Callable[..., subprocess.Popen[str]]) -> Run:
    """Runs `hab-eval` on the stub as a process, as workers and signals need it."""

    def run(*arguments: object, **variables: str) -> subprocess.CompletedProcess[str]:
        process = start_cli(*arguments, **variables)
        out, err = process.communicate(timeout=120)
        return subprocess.CompletedProcess(process.args, process.returncode, out, err)

    return run


@pytest.fixture
def cli(stubbed: None, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs `hab-eval` on the stub in this process, which saves its start."""
    monkeypatch.setenv("COLUMNS", "120")

    def run(*arguments: object) -> subprocess.CompletedProcess[str]:
        capfd.readouterr()
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as stop:  # tyro's way to report options and to show help
            code = stop.code
        out, err = capfd.readouterr()
        return subprocess.CompletedProcess(arguments, code, out, err)

    return run
