"""Files are written aside, and are whole or not there."""

import pytest

from hab_tasks.files import written_aside


def test_a_file_takes_its_place_in_the_end(tmp_path):
    file = tmp_path / "new" / "told.json"
    with written_aside(file) as scratch:
        scratch.write_text("whole")
        assert scratch.suffix == ".json"
        assert not file.exists()
    assert file.read_text() == "whole"
    assert list(file.parent.iterdir()) == [file]


def test_an_older_file_stays_when_writing_fails(tmp_path):
    file = tmp_path / "told.json"
    file.write_text("old")
    with pytest.raises(UnicodeEncodeError), written_aside(file) as scratch:
        scratch.write_text("hä", encoding="ascii")
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def test_what_was_never_written_is_an_error(tmp_path):
    with pytest.raises(FileNotFoundError), written_aside(tmp_path / "told.json"):
        pass
