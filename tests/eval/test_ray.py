"""`hab-eval run --executor ray` on local clusters of one or two nodes."""

import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import stub_runs
from stub_runs import STUBS, journal_ids, results_of

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("ray") is None, reason="the package ray is not installed"
)
slow = pytest.mark.slow

RUN = ("run", "--agent", "stub_cluster:constant", "--env", "HabStub-v1")
RAY = ("--executor", "ray", "--workers", 2)
GONE_WITHIN_S = 20.0


@pytest.fixture(scope="module")
def local(tmp_path_factory):
    """Results of 12 episodes with the local executor."""
    out = tmp_path_factory.mktemp("local") / "run"
    process = stub_runs.start(*RUN, "--episodes", 12, "--out", out)
    assert process.wait(timeout=120) == 0, process.communicate()
    return results_of(out)


@pytest.fixture
def cluster(tmp_path, monkeypatch):
    """Yields a cluster of two nodes, one CPU each, and its second node."""
    for name, value in {
        "RAY_USAGE_STATS_ENABLED": "0",
        "STUB_STEP_S": "0.1",
        "PYTHONPATH": os.pathsep.join([str(STUBS), str(stub_runs.ROOT)]),
    }.items():
        monkeypatch.setenv(name, value)
    from ray.cluster_utils import Cluster

    node = {"num_cpus": 1, "object_store_memory": 100_000_000, "include_dashboard": False}
    cluster = Cluster(initialize_head=True, head_node_args=node, shutdown_at_exit=False)
    yield cluster, cluster.add_node(num_cpus=1, object_store_memory=100_000_000)
    cluster.shutdown()


def wait_for_episodes(process, out, count):
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and process.poll() is None:
        if (out / "episodes.jsonl").is_file() and len(journal_ids(out)) >= count:
            return
        time.sleep(0.02)
    pytest.fail(f"no {count} episodes: {process.communicate(timeout=5)}")


def descendants(pid):
    """Returns the running processes that a process started, in any session, as (pid, start)."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            text = stat.read_text()
        except (FileNotFoundError, ProcessLookupError):
            continue
        state, parent, *rest = text.rpartition(") ")[2].split()
        if state != "Z":
            parents[int(stat.parent.name)] = (int(parent), rest[17])
    found = {pid}
    while more := {child for child, (parent, _) in parents.items() if parent in found} - found:
        found |= more
    return {(child, parents[child][1]) for child in found - {pid}}


def still_running(processes):
    found = []
    for pid, start in processes:
        try:
            rest = Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        if rest[0] != "Z" and rest[19] == start:
            found.append(pid)
    return found


def check_gone(processes):
    deadline = time.monotonic() + GONE_WITHIN_S
    while still_running(processes) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert still_running(processes) == []


def workers_only(processes):
    """Leaves out Ray's agents, which try for a minute to report the death of their parent."""
    agents = (b"ray::DashboardAgent", b"ray::RuntimeEnvAgent")
    return {
        (pid, start)
        for pid, start in processes
        if not Path(f"/proc/{pid}/cmdline").read_bytes().startswith(agents)
    }


@slow
def test_interrupted_and_killed_runs_resume_to_the_local_result(start_cli, tmp_path, local):
    out = tmp_path / "run"
    arguments = (*RUN, *RAY, "--episodes", 12, "--out", out)
    for number, (how, code) in enumerate([(signal.SIGINT, 130), (signal.SIGKILL, -9)]):
        resume = ("--resume",) if number else ()
        process = start_cli(*arguments, *resume, STUB_STEP_S="0.3")
        wait_for_episodes(process, out, 2 * number + 2)
        started = descendants(process.pid)
        assert len(started) > 3
        if how is signal.SIGINT:
            os.killpg(process.pid, how)
        else:
            started = workers_only(started)
            process.kill()
        _, err = process.communicate(timeout=60)
        assert process.returncode == code, err
        assert code < 0 or err.count("\n") == 1, err
        check_gone(started)
    kept = journal_ids(out)
    assert 4 <= len(kept) < 12
    done = start_cli(*arguments, "--resume")
    assert done.wait(timeout=120) == 0, done.communicate()
    assert journal_ids(out)[: len(kept)] == kept
    assert len(journal_ids(out)) == 12
    assert results_of(out) == local


@slow
def test_a_node_that_dies_loses_no_episode(cluster, start_cli, tmp_path, local):
    nodes, second = cluster
    out = tmp_path / "run"
    options = ("--episodes", 12, "--address", nodes.address, "--out", out)
    process = start_cli(*RUN, *RAY, *options)
    wait_for_episodes(process, out, 3)
    kept = journal_ids(out)
    nodes.remove_node(second, allow_graceful=False)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    assert journal_ids(out)[: len(kept)] == kept
    assert sorted(journal_ids(out)) == [f"stub/{i:03d}" for i in range(12)]
    assert results_of(out) == local


@slow
def test_an_episode_that_ends_its_workers_stops_the_run(cli_process, tmp_path):
    out = tmp_path / "run"
    done = cli_process(*RUN, *RAY, "--episodes", 3, "--out", out, STUB_KILL_EPISODE="stub/001")
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert "Episode 'stub/001' stopped the run: its worker process died 3 times" in line
    assert "continue with --resume" in line
    assert "stub/001" not in journal_ids(out)


@slow
def test_an_agent_that_raises_stops_the_run(cli_process, tmp_path):
    out = tmp_path / "run"
    agent = ("run", "--agent", "stub_cluster:raising", "--env", "HabStub-v1")
    done = cli_process(*agent, "--executor", "ray", "--episodes", 5, "--out", out)
    assert done.returncode == 1
    assert "Episode 'stub/002' stopped the run: ZeroDivisionError: three is too" in done.stderr
    assert journal_ids(out) == ["stub/000", "stub/001"]
    assert "in act" in (out / "error.txt").read_text()


@slow
def test_a_real_environment_has_the_local_results(tmp_path):
    script = str(Path(sys.executable).parent / "hab-eval")
    command = (script, "run", "--agent", "hab_eval:random_agent", "--env", "HabPick-v1")
    for name, options in {"local": (), "ray": ("--executor", "ray", "--workers", "2")}.items():
        out = ("--episodes", "3", "--out", str(tmp_path / name))
        done = subprocess.run(
            [*command, *options, *out], capture_output=True, text=True, timeout=300
        )
        assert done.returncode == 0, done.stderr
    assert results_of(tmp_path / "ray") == results_of(tmp_path / "local")
    config = [json.loads((tmp_path / n / "config.json").read_text()) for n in ("ray", "local")]
    assert config[0] == config[1]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--executor", "rey"), ("'rey'", "Did you mean 'ray'?")),
        (("--address", "a:1"), ("--address a:1 needs --executor ray",)),
        (("--executor", "ray", "--address", "nowhere"), ("'nowhere'", "HOST:PORT or auto")),
        (
            ("--executor", "ray", "--address", "127.0.0.1:1"),
            ("127.0.0.1:1: no Ray cluster (Connection refused)", "ray start --head"),
        ),
        (("--executor", "ray", "--video", 1), ("--video needs --executor local",)),
        (("--executor", "ray", "--step-timeout", 9), ("--step-timeout needs --executor local",)),
        (("--executor", "ray", "--agent", "stub_hab:many"), ("agent of one row; Many has 3",)),
    ],
)
def test_options_that_cannot_be_combined_are_named_in_one_line(cli, tmp_path, options, words):
    done = cli(*RUN, *options, "--out", tmp_path / "run")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    for text in words:
        assert text in done.stderr
    assert not (tmp_path / "run").exists()


def test_a_missing_package_is_named_with_the_command_that_installs_it(cli, tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    done = cli(*RUN, "--executor", "ray", "--out", tmp_path / "run")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "pip install 'ray>=2.30'" in done.stderr
    assert not (tmp_path / "run").exists()
