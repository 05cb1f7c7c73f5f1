"""Fixtures and skips for optional resources: real data, Vulkan, Chromium."""

import functools
import gc
import itertools
import os
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

# Tests run in several processes already: more threads in each would only get in the way.
# It counts when torch is imported.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import pytest

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("HAB_TEST_DATA") or ROOT.parent / "shared" / "data")

FILES_SHOWN = 60
"""Number of files in the table of the slowest."""

EPISODES, FEW = 4, 2
"""How many start states of each env are looked at; few where each takes long, or is a variant."""

COLLECTED = 20
"""Of how many of ManiSkill's garbage collections one is made."""

PROBES = {
    "render": "import sapien; sapien.render.RenderSystem()",
    "browser": "import shutil, playwright.sync_api; assert shutil.which('chromium')",
}
REASONS = {
    "render": "no Vulkan device that SAPIEN can use (see the README, Images without a GPU)",
    "browser": "no Chromium or no Playwright (apt-get install chromium)",
}


@pytest.fixture(autouse=True, scope="module")
def _environments_of_a_module_end_with_it():
    """Tests that go through all environments must not meet those that other tests registered."""
    import gymnasium

    from hab_tasks import registration

    before = set(registration.ENTRY_POINTS)
    yield
    for env_id in set(registration.ENTRY_POINTS) - before:
        module = registration._modules.pop(env_id)
        registration.ENTRY_POINTS.pop(env_id)
        registration.TASKS.pop(env_id, None)
        gymnasium.registry.pop(env_id)
        sys.modules.pop(module, None)  # the next import registers them again


@pytest.fixture(autouse=True, scope="session")
def _rare_garbage_collection():
    """ManiSkill collects garbage whenever an environment begins or ends, Python does so by itself.

    Where tests keep many objects, that took half of their time.
    """
    from mani_skill.envs import sapien_env

    calls = itertools.count(1)

    def collect() -> None:
        if next(calls) % COLLECTED == 0:
            gc.collect()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sapien_env, "gc", SimpleNamespace(collect=collect))
        yield


@pytest.fixture(autouse=True, scope="session")
def _one_worker_server():
    """One server forks the workers of all tests; it imports the simulator once."""
    from hab_tasks.io.pool import start_server

    start_server("hab_tasks.vector.workers")


@pytest.fixture
def persistent_contacts(monkeypatch):
    """Scenes of a test are simulated with PhysX's persistent contacts."""
    import dataclasses

    from hab_tasks.engine import hab_env
    from hab_tasks.world.scenes import physics

    config = physics.sim_config()
    contacts = dataclasses.replace(config.scene_config, enable_pcm=True)
    config = dataclasses.replace(config, scene_config=contacts)
    for module in (physics, hab_env):  # which has imported the name
        monkeypatch.setattr(module, "sim_config", lambda: config)
    yield
    monkeypatch.undo()
    physics.use_settings(physics.sim_config())


@pytest.fixture
def run(tmp_path, monkeypatch, capfd):
    """Runs `hab-tasks` in this process, as starting Python costs seconds; with an empty cache."""
    from hab_tasks.cli import main
    from hab_tasks.io import cache

    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(cache, "_said", set())

    def run(*arguments):
        try:
            status = main([str(a) for a in arguments])
        except SystemExit as end:
            status = end.code or 0
        out, err = capfd.readouterr()
        return subprocess.CompletedProcess(arguments, status, out, err)

    return run


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder with the real ReplicaCAD and YCB."""
    return _present(DATA)


@pytest.fixture(scope="session")
def replica_cad() -> Path:
    """The real ReplicaCAD; read-only."""
    return _present(DATA / "replica_cad")


@pytest.fixture(scope="session")
def ycb() -> Path:
    """The real YCB objects; read-only."""
    return _present(DATA / "ycb")


@pytest.fixture(scope="session")
def generated(tmp_path_factory):
    """Makes (source, episodes) of an env; each set once, with fewer that differ from the usual."""
    from hab_tasks.episodes import EpisodeRequest, open_source

    @functools.cache
    def make(
        env_id: str, dataset: str = "apartment", novel: str | None = None, scene: str | None = None
    ):
        real = {"scene_dataset": DATA / "replica_cad", "objects": DATA / "ycb"}
        options = real if dataset == "real" else {"scene_dataset": dataset}
        with pytest.MonkeyPatch.context() as patch:
            # With an empty cache, so that nothing made by an older version is found.
            patch.setenv("HAB_CACHE_DIR", str(tmp_path_factory.mktemp("episodes")))
            request = EpisodeRequest(env_id=env_id, seed=77, novel=novel, scene=scene, **options)
            source = open_source(request)
            tasks = ("HabTidyHouse-v1", "HabPrepareGroceries-v1", "HabSetTable-v1")
            count = FEW if novel or scene or env_id in tasks else EPISODES
            return source, tuple(source.get(index) for index in range(count))

    return make


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests first, so that no process ends with one when the others are idle."""
    slow = {
        item.path
        for item in items
        if item.get_closest_marker("slow") or item.get_closest_marker("long")
    }
    items.sort(key=lambda item: item.path not in slow)


def pytest_collection_finish() -> None:
    """ManiSkill collects garbage with each environment that ends: not of all that was imported."""
    gc.freeze()


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """With `--durations`, shows which files take longest."""
    if not terminalreporter.config.getoption("durations"):
        return
    seconds = Counter[str]()
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport):
                seconds[report.nodeid.split("::")[0]] += report.duration
    terminalreporter.section("slowest files")
    for path, total_s in seconds.most_common(FILES_SHOWN):
        terminalreporter.write_line(f"{total_s:7.0f} s  {path}")


def pytest_configure(config: pytest.Config) -> None:
    """Gives all processes of a run one cache of their own, which is empty at first.

    The user's cache may have episodes that a test wants to see generated.
    """
    if not hasattr(config, "workerinput"):
        folder = tempfile.TemporaryDirectory(prefix="hab-tests-")
        config.add_cleanup(folder.cleanup)
        os.environ["HAB_CACHE_DIR"] = folder.name


def pytest_unconfigure() -> None:
    """What is never looked at counts as leaked when Python ends."""
    gc.unfreeze()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a marked test where the machine lacks what its mark names."""
    if item.get_closest_marker("assets"):
        _present(DATA)
    for mark, reason in REASONS.items():
        if item.get_closest_marker(mark) and not _works(mark):
            pytest.skip(reason)


def _present(folder: Path) -> Path:
    if not folder.is_dir():
        pytest.skip(f"no {folder}; set HAB_TEST_DATA to a folder with replica_cad/ and ycb/")
    return folder


@functools.cache
def _works(mark: str) -> bool:
    """Whether this machine has what ``mark`` needs; a process of its own, as SAPIEN may end it."""
    probe = subprocess.run([sys.executable, "-c", PROBES[mark]], capture_output=True, timeout=120)
    return probe.returncode == 0
