"""`hab-eval run` on the stub environment of tests/eval, in this process and in another."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from hab_eval.records.results import EpisodeResult, RunRecord, summarize

ROOT = Path(__file__).resolve().parents[1]
STUBS = ROOT / "tests" / "eval"
if str(STUBS) not in sys.path:
    sys.path.insert(0, str(STUBS))  # so that stub_hab has one name here and in worker processes

RUN = ("run", "--agent", "stub_hab:constant", "--env", "HabStub-v1")
FAULTY = ("run", "--agent", "faulty_agents:made", "--env", "HabStub-v1")


def start(*arguments: object, **variables: str) -> subprocess.Popen[str]:
    """Starts `hab-eval` on the stub in a process group of its own."""
    path = os.pathsep.join([str(STUBS), str(ROOT), str(ROOT / "eval")])
    return subprocess.Popen(
        [sys.executable, str(STUBS / "stub_main.py"), *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": path, "COLUMNS": "120", **variables},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # Tests started in a shell's background ignore Ctrl-C, and so would this process.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def results_of(folder: Path) -> list[dict[str, Any]]:
    """Returns the episodes of `run.json` without what may differ between two runs."""
    data = json.loads((folder / "run.json").read_text())["episodes"]
    return [{key: value for key, value in one.items() if key != "seconds"} for one in data]


def traces_of(folder: Path) -> dict[str, Any]:
    """Returns episode id -> what its agent told, from `traces.jsonl`."""
    lines = map(json.loads, (folder / "traces.jsonl").read_text().splitlines())
    return {line["id"]: line["trace"] for line in lines}


def journal_ids(folder: Path) -> list[str]:
    """Returns the ids of the finished episodes, in the order in which they ended."""
    lines = (folder / "episodes.jsonl").read_text().splitlines()
    return [json.loads(line)["episode"]["id"] for line in lines]


def make_record(
    successes: Sequence[bool] = (True, False), *, name: str = "Stub", **changes: Any
) -> RunRecord:
    """Returns the record of a run of Pick, with an episode for each of `successes`."""
    episodes = tuple(
        EpisodeResult(
            id=f"e{number}",
            scene="s",
            success=success,
            stages={"pick_1": success},
            steps=10 * (number + 1),
            failure=None if success else "timeout",
            episode_return=float(number),
            seconds=0.5,
        )
        for number, success in enumerate(successes)
    )
    timings_s = {"e0": {"plan": 0.25}}
    record = RunRecord(
        schema=1,
        agent="stub_hab:constant",
        agent_name=name,
        privileged=False,
        control_mode="ee",
        obs_mode="state_dict",
        env="HabPick-v1",
        scene_dataset="apartment",
        objects=None,
        split="val",
        seed=0,
        versions={"hab-tasks": "0.1.0"},
        git="0123456789abcdef",
        device="cpu",
        episodes=episodes,
        timings_s=timings_s,
        summary=summarize(episodes, timings_s),
    )
    return replace(record, **changes)
