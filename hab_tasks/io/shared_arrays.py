"""Arrays in memory that a process shares with its workers; it has no name, so nothing can be left.

The memory is an anonymous file: it is freed when the last process that maps it ends, however it
ends, and is not limited by the size of ``/dev/shm``.
"""

from __future__ import annotations

import mmap
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hab_tasks.errors import HabError

ALIGNMENT_BYTES = 64
"""A cache line, so that processes do not write to the same one."""


@dataclass(frozen=True, kw_only=True)
class ArraySpec:
    """Shape and type of a shared array."""

    shape: tuple[int, ...]
    dtype: str

    @property
    def size_bytes(self) -> int:
        """Its size."""
        return prod(self.shape) * np.dtype(self.dtype).itemsize


class SharedMemoryError(HabError):
    """The memory for the arrays cannot be had."""

    def __init__(self, size_bytes: int, reason: str) -> None:
        super().__init__(
            f"No shared memory of {size_bytes / 1e6:.1f} MB for observations and actions "
            f"({reason}). Use fewer rows (num_envs), smaller images (camera_size_px) or fewer "
            "info_keys."
        )


class SharedArrays:
    """Named arrays in one block of shared memory, an anonymous file of this descriptor."""

    def __init__(self, specs: Mapping[str, ArraySpec], file: int | None = None) -> None:
        """Creates zeroed arrays, or maps those of another process.

        Args:
            specs: Name -> shape and type, equal in all processes.
            file: Descriptor from the process that created them; owned by this instance from now on.

        Raises:
            SharedMemoryError: There is not enough memory.
        """
        size, offsets = 0, {}
        for name, spec in specs.items():
            offsets[name] = size
            size += -(-spec.size_bytes // ALIGNMENT_BYTES) * ALIGNMENT_BYTES
        self.file = _new_file(max(size, 1)) if file is None else file
        try:
            self._memory = mmap.mmap(self.file, max(size, 1))
        except OSError as error:
            os.close(self.file)
            raise SharedMemoryError(size, error.strerror or str(error)) from error
        self.arrays: dict[str, NDArray[Any]] = {
            name: np.frombuffer(self._memory, spec.dtype, prod(spec.shape), offsets[name]).reshape(
                spec.shape
            )
            for name, spec in specs.items()
        }

    def close(self) -> None:
        """Closes the file; the memory is freed with the last array."""
        if self.file >= 0:
            os.close(self.file)
            self.file = -1
        self.arrays = {}


def _new_file(size_bytes: int) -> int:
    """Returns an anonymous file whose memory is reserved, so that writing cannot fail later."""
    try:
        if hasattr(os, "memfd_create"):
            file = os.memfd_create("hab_tasks")
        else:
            with tempfile.TemporaryFile() as temporary:
                file = os.dup(temporary.fileno())
    except OSError as error:
        raise SharedMemoryError(size_bytes, error.strerror or str(error)) from error
    try:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file, 0, size_bytes)
        else:
            os.ftruncate(file, size_bytes)
    except OSError as error:
        os.close(file)
        raise SharedMemoryError(size_bytes, error.strerror or str(error)) from error
    return file
