"""Shared fixtures of the tests of invalid input."""

import pytest
import stub_runs  # noqa: F401  # first: it finds the stub

import stub_hab  # isort: skip


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory, monkeypatch):
    """A cache of the tests' own, so that nothing is found in it or left in it."""
    folder = tmp_path_factory.getbasetemp() / "faults-cache"
    monkeypatch.setenv("HAB_CACHE_DIR", str(folder))
    return folder


@pytest.fixture
def stubbed():
    """`hab-eval run` plays the stub environment."""
    undo = stub_hab.install()
    yield
    undo()
