"""Shared fixtures of the command-line tests."""

import subprocess

import pytest

from hab_tasks.cli import main
from hab_tasks.scenes.habitat import load


@pytest.fixture
def run(tmp_path, monkeypatch, capfd):
    """Runs the command in this process, as starting Python costs seconds; with an empty cache."""
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(load, "_said", set())

    def run(*arguments):
        try:
            status = main([str(a) for a in arguments])
        except SystemExit as end:
            status = end.code or 0
        out, err = capfd.readouterr()
        return subprocess.CompletedProcess(arguments, status, out, err)

    return run
