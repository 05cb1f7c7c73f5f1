"""Shared arrays of the vector environment: alignment, and the memory that is freed or lacking."""

import os

import pytest

from hab_tasks.io.shared_arrays import ALIGNMENT_BYTES, ArraySpec, SharedArrays, SharedMemoryError


def test_arrays_are_shared_and_aligned_until_they_are_closed():
    specs = {
        "action": ArraySpec(shape=(3, 2), dtype="<f4"),
        "ended": ArraySpec(shape=(3,), dtype="|b1"),
        "empty": ArraySpec(shape=(3, 0), dtype="<f4"),
        "steps": ArraySpec(shape=(3,), dtype="<i4"),
    }
    ours = SharedArrays(specs)
    file = ours.file
    theirs = SharedArrays(specs, os.dup(file))
    for name, array in ours.arrays.items():
        assert not array.any()
        assert array.shape == specs[name].shape
        assert array.size == 0 or array.ctypes.data % ALIGNMENT_BYTES == 0
    ours.arrays["steps"][:] = 1, 2, 3
    theirs.arrays["ended"][1] = True
    assert theirs.arrays["steps"].tolist() == [1, 2, 3]
    assert ours.arrays["ended"].tolist() == [False, True, False]
    theirs.close()
    assert "memfd" in os.readlink(f"/proc/self/fd/{file}")
    ours.close()
    assert not os.path.lexists(f"/proc/self/fd/{file}")


@pytest.mark.parametrize("function", ["posix_fallocate", "memfd_create"])
def test_without_memory_the_error_says_what_to_do(monkeypatch, function):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, function, full)
    files = len(os.listdir("/proc/self/fd"))
    with pytest.raises(SharedMemoryError, match=r"0\.4 MB .*No space left.*fewer rows"):
        SharedArrays({"obs": ArraySpec(shape=(100, 1000), dtype="<f4")})
    assert len(os.listdir("/proc/self/fd")) == files
