"""Executors: each job once, in order of completion, in processes of this machine or of Ray."""

import os
from collections import Counter

import pytest

from hab_tasks.cli import main
from hab_tasks.errors import RunStoppedError
from hab_tasks.io.executors import ExecutorChoice, Task, open_executor
from hab_tasks.io.executors.ray_executor import JobWorker, Origin, this_origin

EPISODES = ("episodes", "--env", "HabPick-v1", "--split", "val", "--seed", "7", "--count", "4")


def start(first):
    return lambda job: (first + job, os.getpid())


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_local_jobs_run_once_each(workers):
    task = Task(start=start, arguments=(10,), name="Job {}".format)
    with open_executor(ExecutorChoice(), workers) as executor:
        answers = dict(executor.run(task, [3, 4, 5]))
    assert {index: value for index, (value, _) in answers.items()} == {0: 13, 1: 14, 2: 15}
    here = {pid == os.getpid() for _, pid in answers.values()}
    assert here == {workers == 1}


def test_a_worker_refuses_other_versions_and_names_a_job_that_raises():
    origin = this_origin()
    other = Origin(versions={**origin.versions, "torch": "0.1"}, folder="/", path=())
    answer = JobWorker().start(other, start, (1,))
    assert "instead of 0.1; install the same versions" in str(answer.error)
    worker = JobWorker()
    worker.start(origin, start, (1,))
    answer = worker.work("Job a", "a")
    assert isinstance(answer.error, RunStoppedError)
    assert str(answer.error).startswith("Job a stopped the run: TypeError")


@pytest.mark.long
def test_episodes_generated_on_ray_are_those_of_one_process(tmp_path, monkeypatch, capsys):
    pytest.importorskip("ray", reason="the package ray is not installed")
    for name, options in {"local": (), "ray": ("--executor", "ray", "--workers", "2")}.items():
        monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path / f"cache_{name}"))
        assert main([*EPISODES, *options, "--out", str(tmp_path / f"{name}.json")]) == 0
    assert (tmp_path / "local.json").read_bytes() == (tmp_path / "ray.json").read_bytes()
    assert Counter(capsys.readouterr().out.split())["wrote"] == 2
