"""Episodes that several processes share through a folder."""

import os
import signal
from dataclasses import replace

import pytest

from hab_tasks.episodes import EpisodeMaker, EpisodeRequest, Wanted, open_source
from hab_tasks.episodes.source import shared_sources

REQUEST = EpisodeRequest(env_id="HabOpenDrawer-v1", split="train", seed=77)


def source_in(folder, request=REQUEST):
    with shared_sources(folder):
        return open_source(request)


@pytest.mark.slow
def test_sets_are_made_by_processes_of_which_any_may_be_killed(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("HAB_CACHE_DIR", str(tmp_path))
    early = open_source(REQUEST)
    with EpisodeMaker([Wanted(REQUEST, 2), Wanted(REQUEST, 10**6, later=True)], 1) as maker:
        maker.wait(0)
        for worker in maker._workers.values():
            os.kill(worker.pid, signal.SIGKILL)
        maker.wait(1)
    assert "killed by signal 9, possibly for lack of memory; missing episodes are" in caplog.text
    with EpisodeMaker([Wanted(REQUEST, 3)]) as maker:
        maker.wait(0)
    monkeypatch.setattr(early, "make", lambda index: pytest.fail("generated again"))
    assert early.to_set(2) == open_source(REQUEST).to_set(2)
    assert early.get(2) == open_source(REQUEST).make(2).episode


def test_only_episodes_of_the_same_source_are_not_generated_again(tmp_path, monkeypatch):
    first = source_in(tmp_path)
    made = first.get(0)
    other = source_in(tmp_path)
    monkeypatch.setattr(other, "make", lambda index: pytest.fail("generated again"))
    assert other.get(0) == made
    assert other.rejections == first.rejections
    different = source_in(tmp_path, replace(REQUEST, seed=78))
    assert different.get(0).id.endswith("/78/00000")
    assert len(list(tmp_path.iterdir())) == 2


def test_a_damaged_file_and_a_missing_folder_are_ignored(tmp_path):
    made = source_in(tmp_path / "one").get(0)
    (file,) = (tmp_path / "one").iterdir()
    file.write_text("{")
    assert source_in(tmp_path / "one").get(0) == made
    (tmp_path / "two").write_text("no folder")
    assert source_in(tmp_path / "two").get(0) == made
