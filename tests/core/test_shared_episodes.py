"""Episodes that several processes share through a folder."""

import pytest

from hab_tasks.episodes.source import EpisodeRequest, open_source, shared_sources


def source_in(folder, seed=77):
    request = EpisodeRequest(env_id="HabOpenDrawer-v1", split="train", seed=seed)
    with shared_sources(folder):
        return open_source(request)


def test_only_episodes_of_the_same_source_are_not_generated_again(tmp_path, monkeypatch):
    first = source_in(tmp_path)
    made = first.get(0)
    other = source_in(tmp_path)
    monkeypatch.setattr(other, "make", lambda index: pytest.fail("generated again"))
    assert other.get(0) == made
    assert other.rejections == first.rejections
    different = source_in(tmp_path, seed=78)
    assert different.get(0).id.endswith("/78/00000")
    assert len(list(tmp_path.iterdir())) == 2


def test_a_damaged_file_and_a_missing_folder_are_ignored(tmp_path):
    made = source_in(tmp_path / "one").get(0)
    (file,) = (tmp_path / "one").iterdir()
    file.write_text("{")
    assert source_in(tmp_path / "one").get(0) == made
    (tmp_path / "two").write_text("no folder")
    assert source_in(tmp_path / "two").get(0) == made
