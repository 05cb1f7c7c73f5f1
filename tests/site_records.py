"""Records for tests of the results site and of submissions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from hab_eval.records.results import EpisodeResult, RunRecord, summarize, write_record
from stub_runs import make_record

CLEAN_COMMIT = "0123456789abcdef0123456789abcdef01234567"


def record_of(
    failures: Sequence[str | None],
    *,
    stages: Sequence[str] = (),
    scores: Sequence[str] = (),
    **changes: Any,
) -> RunRecord:
    """Returns a record with the ids of its protocol; a failure of None is a success."""
    record = make_record(**{"git": CLEAN_COMMIT, **changes})
    head = f"{record.env}/{record.scene_dataset}/{record.split}/{record.seed}"
    episodes = tuple(
        EpisodeResult(
            id=f"{head}/{index:05d}",
            scene=f"layout_{index % 2}",
            success=failure is None,
            stages={name: failure is None or not number for number, name in enumerate(stages)},
            steps=10 + index,
            failure=failure,
            episode_return=float(index),
            scores={name: 0.5 if failure is None else 0.0 for name in scores},
            seconds=0.5,
        )
        for index, failure in enumerate(failures)
    )
    return replace(record, episodes=episodes, timings_s={}, summary=summarize(episodes, {}))


def write_submissions(folder: Path) -> Path:
    """Writes four submissions of two environments to a folder."""
    folder.mkdir(parents=True)
    pick = {"env": "HabPick-v1"}
    runs = {
        "spa-pick-apartment-seed0": record_of(
            [None] * 8 + ["timeout"] * 2, name="SPA", agent="hab_spa:spa", privileged=True, **pick
        ),
        "pick_blind-pick-apartment-seed0": record_of(
            [None, "force", *[None] * 2, *["timeout"] * 5, None],
            name="Blind",
            agent="hab_ppo:pick_blind",
            options={"weights": "runs/x y"},
            scores=["sct"],
            **pick,
        ),
        "random_agent-pick-replica_cad-seed1": record_of(
            ["wrong_object"] * 60,
            name="Random",
            agent="hab_eval:random_agent",
            seed=1,
            scene_dataset="replicaCAD",
            objects="ycb",
            split="train",
            **pick,
        ),
        "tp_spa_priv-tidy_house-apartment-seed5": record_of(
            [None, "motion plan", None],
            stages=("pick_1", "place_1"),
            name="TP+SPA-Priv",
            agent="hab_spa:tp_spa_priv",
            env="HabTidyHouse-v1",
            seed=5,
        ),
    }
    for name, record in runs.items():
        write_record(folder / f"{name}.json", record)
    return folder
