"""Atomic writes, and errors for unwritable paths."""

import errno
import os
import resource
import shutil
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial

import pytest
from killed import FILE, FOLDER, killed_while_writing
from refusals import refused_by_call

from hab_tasks.errors import FileError
from hab_tasks.files import (
    ASIDE,
    STALE_S,
    check_file,
    check_folder,
    folder_written_aside,
    scratch_folder,
    written_aside,
)

MARK = "made_here.json"


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


def write(path, text="new"):
    with written_aside(path) as scratch:
        scratch.write_text(text)


def fill(path):
    with folder_written_aside(path) as scratch:
        (scratch / MARK).write_text("new")


@contextmanager
def no_room(most_bytes):
    """The system refuses to write files larger than this, as it does when the disk is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def a_folder(tmp_path):
    (tmp_path / "told.json").mkdir()
    return tmp_path / "told.json", "is a folder"


def a_pipe(tmp_path):
    os.mkfifo(tmp_path / "told.json")
    return tmp_path / "told.json", "is a device, pipe or socket"


def a_link_to_a_device(tmp_path):
    (tmp_path / "told.json").symlink_to("/dev/null")
    return tmp_path / "told.json", "is a device, pipe or socket"


def below_a_file(tmp_path):
    (tmp_path / "file").write_text("precious")
    return tmp_path / "file" / "new" / "told.json", "file is a file, not a folder"


def a_link_to_nothing(tmp_path):
    (tmp_path / "told.json").symlink_to(tmp_path / "nothing")
    return tmp_path / "told.json", "is a link to"


def a_link_to_itself(tmp_path):
    (tmp_path / "told.json").symlink_to(tmp_path / "told.json")
    return tmp_path / "told.json", "told.json"


def a_long_name(tmp_path):
    return tmp_path / ("n" * 300), os.strerror(errno.ENAMETOOLONG)


def a_name_with_a_nul(tmp_path):
    return tmp_path / "told\0.json", "null"


def a_name_that_is_no_text(tmp_path):
    return tmp_path / "told\ud800.json", "surrogates not allowed"


NO_FILES = (
    a_folder,
    a_pipe,
    a_link_to_a_device,
    below_a_file,
    a_link_to_nothing,
    a_link_to_itself,
    a_long_name,
    a_name_with_a_nul,
    a_name_that_is_no_text,
)


def test_what_can_be_no_file_or_folder_is_refused_before_the_work_and_by_the_writer(tmp_path):
    for bad in NO_FILES:
        folder = tmp_path / bad.__name__
        folder.mkdir()
        path, words = bad(folder)
        before = sorted(folder.rglob("*"))
        for force in (False, True):
            refused_by_call(partial(check_file, path, force=force), words)
        refused_by_call(partial(write, path), path.name[:5].rstrip("\0\ud800"))
        if bad is not a_folder:
            refused_by_call(partial(check_folder, path, force=True, mark=MARK), words)
            with pytest.raises(FileError):
                fill(path)
        assert sorted(folder.rglob("*")) == before, bad.__name__


def test_a_folder_that_the_command_has_not_made_is_never_replaced(tmp_path):
    (tmp_path / "thesis.txt").write_text("precious")
    for force in (False, True):
        refused_by_call(partial(check_folder, tmp_path, force=force, mark=MARK), f"no {MARK}")


def test_a_folder_that_the_command_has_made_is_replaced_when_asked(tmp_path):
    folder = tmp_path / "made"
    fill(folder)
    (folder / "more").write_text("old")
    refused_by_call(partial(check_folder, folder, force=False, mark=MARK), "exists", "--force")
    check_folder(folder, force=True, mark=MARK)
    fill(folder)
    assert [file.name for file in folder.iterdir()] == [MARK]
    assert list(tmp_path.iterdir()) == [folder]


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
    with no_room(1000):
        refused_by_call(partial(write, file, "x" * 2000), str(file), os.strerror(errno.EFBIG))
        with pytest.raises(FileError, match="File too large"), folder_written_aside(folder) as new:
            (new / "big").write_text("x" * 2000)
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


def test_what_others_are_writing_stays(tmp_path):
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


def test_a_scratch_folder_is_gone_in_the_end(tmp_path):
    with scratch_folder(tmp_path / "out") as scratch:
        (scratch / "kept").write_text("kept")
        (scratch / "dropped").write_text("")
        shutil.move(scratch / "kept", tmp_path / "out/kept")
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["kept"]
