"""Shared arrays free their memory when they are closed."""

import os

from hab_tasks.vector.shared_arrays import ArraySpec, SharedArrays


def test_closing_closes_the_anonymous_file():
    shared = SharedArrays({"a": ArraySpec(shape=(3,), dtype="<f4")})
    file = shared.file
    assert "memfd" in os.readlink(f"/proc/self/fd/{file}")
    shared.close()
    assert not os.path.lexists(f"/proc/self/fd/{file}")
