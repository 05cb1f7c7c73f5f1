"""`hab-eval run --executor ray` on local clusters of one or two nodes."""

import importlib.util
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
import stub_runs
from hab_eval.cli import main
from refusals import check_each
from sockets import check_loopback
from stub_runs import STUBS, journal_ids, results_of

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("ray") is None, reason="the package ray is not installed"
)
slow = pytest.mark.slow

RUN = ("run", "--agent", "stub_cluster:constant", "--env", "HabStub-v1")
RAY = ("--executor", "ray", "--workers", 2)
GONE_WITHIN_S = 20.0
AGENTS = ("ray::DashboardAgent", "ray::RuntimeEnvAgent")


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


@pytest.fixture
def local(cli, tmp_path):
    """Results of 12 episodes with the local executor."""
    assert cli(*stub_runs.RUN, "--episodes", 12, "--out", tmp_path / "local").returncode == 0
    return results_of(tmp_path / "local")


def still_runs(process):
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def check_gone(processes):
    deadline_s = time.monotonic() + GONE_WITHIN_S
    while (found := list(filter(still_runs, processes))) and time.monotonic() < deadline_s:
        time.sleep(0.1)
    assert found == []


@slow
def test_interrupted_and_killed_runs_resume_to_the_local_result(
    start_cli, wait_for_episodes, tmp_path, local
):
    out = tmp_path / "run"
    arguments = (*RUN, *RAY, "--episodes", 12, "--out", out)
    for number, (how, code) in enumerate([(signal.SIGINT, 130), (signal.SIGKILL, -9)]):
        resume = ("--resume",) if number else ()
        process = start_cli(*arguments, *resume, STUB_STEP_S="0.3")
        wait_for_episodes(process, out, 2 * number + 2)
        check_loopback(psutil.Process(process.pid))
        started = psutil.Process(process.pid).children(recursive=True)
        assert len(started) > 3
        if how is signal.SIGINT:
            os.killpg(process.pid, how)
        else:  # Ray's agents try for a minute to report the death of their parent
            started = [one for one in started if not " ".join(one.cmdline()).startswith(AGENTS)]
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
def test_a_node_that_dies_loses_no_episode(cluster, start_cli, wait_for_episodes, tmp_path, local):
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
def test_a_real_environment_has_the_local_results(tmp_path):
    command = ("run", "--agent", "hab_eval:random_agent", "--env", "HabPick-v1", "--episodes", "3")
    assert main([*command, "--out", str(tmp_path / "local")]) == 0
    script = str(Path(sys.executable).parent / "hab-eval")
    ray = ("--executor", "ray", "--workers", "2", "--out", str(tmp_path / "ray"))
    done = subprocess.run([script, *command, *ray], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert results_of(tmp_path / "ray") == results_of(tmp_path / "local")
    configs = [(tmp_path / name / "config.json").read_text() for name in ("ray", "local")]
    assert configs[0] == configs[1]


ON_RAY = ("--executor", "ray")
REFUSED = (
    (("--address", "a:1"), "--address a:1 needs --executor ray"),
    ((*ON_RAY, "--address", "nowhere"), "'nowhere': it has to be HOST:PORT or auto"),
    ((*ON_RAY, "--address", "127.0.0.1:1"), "127.0.0.1:1: no Ray cluster (Connection refused)"),
    ((*ON_RAY, "--video", 1), "--video needs --executor local"),
    ((*ON_RAY, "--step-timeout", 9), "--step-timeout needs --executor local"),
    ((*ON_RAY, "--agent", "stub_hab:many"), "agent of one row; Many has 3"),
)


def test_options_that_cannot_be_combined_are_named_in_one_line(cli, tmp_path, monkeypatch):
    def check(case):
        options, message = case
        done = cli(*RUN, *options, "--out", tmp_path / "run")
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert message in done.stderr
        assert not (tmp_path / "run").exists()

    check_each({str(case[0]): case for case in REFUSED}, check)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    check((ON_RAY, "pip install 'ray>=2.30'"))
