"""Atomic writes, and errors for unwritable paths."""

import errno
import os
import resource
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest
from killed import FILE, FOLDER, killed_while_writing
from refusals import refused_by_call

from hab_tasks.errors import FileError
from hab_tasks.io.files import (
    ASIDE,
    STALE_S,
    check_file,
    check_folder,
    folder_written_aside,
    written_aside,
)

MARK = "made_here.json"


def test_a_file_takes_its_place_in_the_end_and_stays_when_writing_fails(tmp_path):
    file = tmp_path / "new" / "told.json"
    with written_aside(file) as scratch:
        scratch.write_text("whole")
        assert scratch.suffix == ".json"
        assert not file.exists()
    with pytest.raises(UnicodeEncodeError), written_aside(file) as scratch:
        scratch.write_text("hä", encoding="ascii")
    assert file.read_text() == "whole"
    assert list(file.parent.iterdir()) == [file]
    (tmp_path / "plain").write_text("")
    assert file.stat().st_mode == (tmp_path / "plain").stat().st_mode, "others may read it too"
    with pytest.raises(FileNotFoundError), written_aside(tmp_path / "told.json"):
        pass  # it was never written


def write(path, text="new"):
    with written_aside(path) as scratch:
        scratch.write_text(text)


def fill(path):
    with folder_written_aside(path) as scratch:
        (scratch / MARK).write_text("new")


NO_FILES = {
    "folder": "is a folder",
    "pipe": "is a device, pipe or socket",
    "device": "is a device, pipe or socket",
    "file/new/told.json": "file is a file, not a folder",
    "dangling": "is a link to",
    "loop": "loop",
    "n" * 300: os.strerror(errno.ENAMETOOLONG),
    "told\0.json": "null",
    "told\ud800.json": "surrogates not allowed",
}
"""Path -> words of its refusal."""


def test_what_can_be_no_file_or_folder_is_refused_before_the_work_and_by_the_writer(tmp_path):
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_text("precious")
    for name, target in {"device": "/dev/null", "dangling": "nothing", "loop": "loop"}.items():
        (tmp_path / name).symlink_to(target)
    before = sorted(tmp_path.rglob("*"))
    for name, words in NO_FILES.items():
        path = tmp_path / name
        for force in (False, True):
            refused_by_call(partial(check_file, path, force=force), words)
        refused_by_call(partial(write, path), str(tmp_path))
        if name != "folder":
            refused_by_call(partial(check_folder, path, force=True, mark=MARK), words)
            refused_by_call(partial(fill, path), str(tmp_path))
        assert sorted(tmp_path.rglob("*")) == before, name


def test_only_a_folder_that_the_command_has_made_is_replaced_and_only_when_asked(tmp_path):
    (tmp_path / "thesis.txt").write_text("precious")
    refused_by_call(partial(check_folder, tmp_path, force=True, mark=MARK), f"no {MARK}")
    folder = tmp_path / "new" / "made"
    fill(folder)
    (folder / "more").write_text("old")
    refused_by_call(partial(check_folder, folder, force=False, mark=MARK), "exists", "--force")
    check_folder(folder, force=True, mark=MARK)
    fill(folder)
    assert [file.name for file in folder.iterdir()] == [MARK]
    assert list(folder.parent.iterdir()) == [folder]


def test_a_link_stays_and_its_file_is_replaced(tmp_path):
    (tmp_path / "far").mkdir()
    (tmp_path / "far/told.json").write_text("old")
    (tmp_path / "link.json").symlink_to(tmp_path / "far/told.json")
    check_file(tmp_path / "link.json", force=True)
    write(tmp_path / "link.json")
    assert (tmp_path / "link.json").is_symlink()
    assert (tmp_path / "far/told.json").read_text() == "new"


def test_a_disk_without_room_is_told_and_keeps_what_was_there(tmp_path):
    file, folder = tmp_path / "told.json", tmp_path / "made"
    write(file, "old")
    fill(folder)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    # The system refuses to write files larger than this, as it does when the disk is full.
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        refused_by_call(partial(write, file, "x" * 2000), str(file), os.strerror(errno.EFBIG))
        with pytest.raises(FileError, match="File too large"), folder_written_aside(folder) as new:
            (new / "big").write_text("x" * 2000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert file.read_text() == "old"
    assert (folder / MARK).read_text() == "new"
    assert sorted(tmp_path.iterdir()) == [folder, file]


def test_threads_may_write_the_same_file_at_once(tmp_path):
    texts = [str(number) * 5000 for number in range(8)]
    together = threading.Barrier(4)

    def write_often(thread):
        together.wait(timeout=30)
        for _ in range(50):
            write(tmp_path / "told.json", texts[thread])

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(write_often, range(4)))
    assert (tmp_path / "told.json").read_text() in texts
    assert list(tmp_path.iterdir()) == [tmp_path / "told.json"]


def test_the_next_writer_removes_what_a_killed_one_left(tmp_path):
    for name, code in {"file": FILE, "folder": FOLDER}.items():
        (tmp_path / name).mkdir()
        killed_while_writing(code, tmp_path / name / "told.json")
        (left,) = (tmp_path / name).iterdir()
        assert left.name.startswith(ASIDE)
        write(tmp_path / name / "other.json")
        assert [file.name for file in (tmp_path / name).iterdir()] == ["other.json"]


def test_what_others_are_writing_stays(tmp_path, monkeypatch):
    monkeypatch.setattr("time.time", lambda: 1e10)  # this machine's clock is wrong
    with written_aside(tmp_path / "a.json") as first:
        first.write_text("a")
        elsewhere = tmp_path / f"{ASIDE}0badcafe-1-0123.json"
        elsewhere.write_text("written by another machine just now")
        write(tmp_path / "b.json")
        assert first.exists()
        assert elsewhere.exists()
    long_ago = elsewhere.stat().st_mtime - STALE_S - 1.0
    os.utime(elsewhere, (long_ago, long_ago))
    write(tmp_path / "c.json")
    assert not elsewhere.exists()


def test_a_folder_that_was_changing_places_comes_back(tmp_path):
    fill(tmp_path / "made")
    (tmp_path / "made").rename(tmp_path / ".made.old")  # what a kill between two renames leaves
    with pytest.raises(RuntimeError), folder_written_aside(tmp_path / "made"):
        raise RuntimeError
    assert (tmp_path / "made" / MARK).read_text() == "new"
