"""Loads compiled kernels; numba compiles them once per machine, into the cache folder."""

from __future__ import annotations

import logging
import os
import shutil
from collections.abc import Callable
from functools import lru_cache
from hashlib import blake2b
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from hab_tasks.io.cache import say_unwritable, writable_dir

logger = logging.getLogger(__name__)

FOLDER = "numba"


@lru_cache(maxsize=1)
def kernel() -> Any:
    """Returns the module `hab_tasks.world.raycast.kernel`, compiled."""
    return load("hab_tasks.world.raycast.kernel", _compile)


def load(name: str, call: Callable[[Any], object]) -> Any:
    """Imports a module of compiled functions.

    By default, numba writes compiled functions beside the source, which an installed package may
    forbid. They are written to ``NUMBA_CACHE_DIR`` if it is set, else to the cache folder. `call`
    calls the functions, which compiles them or reads them from the cache.
    """
    # Takes a second, for images and plans only.
    from numba.core import config as numba_config

    config: Any = numba_config
    before = config.CACHE_DIR
    folder = Path(before) if _is_writable(before) else writable_dir(FOLDER)
    config.CACHE_DIR = str(folder / _digest(name))
    try:
        module = import_module(name)
    finally:
        config.CACHE_DIR = before  # it applies to the user's functions as well
    try:
        call(module)
    except Exception as error:  # a damaged entry raises anything that pickle raises
        _do_without(folder, module, error)
        call(module)
    return module


def _do_without(folder: Path, module: Any, error: Exception) -> None:
    """Removes the module's entries in the cache, or keeps new ones in memory if it is full."""
    from numba.core.caching import NullCache

    functions = [entry for entry in vars(module).values() if hasattr(entry, "stats")]
    cached = [function for function in functions if function.stats.cache_path]
    if isinstance(error, OSError):
        say_unwritable(error)
        for function in cached:
            function._cache = NullCache()
        return
    logger.warning("%s: damaged cache entry (%s); it is recomputed.", folder, error)
    for path in {function.stats.cache_path for function in cached}:
        shutil.rmtree(path, ignore_errors=True)


def _digest(name: str) -> str:
    """Returns a digest of a module's folder: numba misses changes of the modules it imports."""
    package = import_module(name.rpartition(".")[0])
    sources = sorted(Path(str(package.__file__)).parent.glob("*.py"))
    return blake2b(b"".join(path.read_bytes() for path in sources), digest_size=8).hexdigest()


def _is_writable(folder: str) -> bool:
    """Returns whether a folder is given, and exists or can be made, and can be written to."""
    try:
        if folder:
            Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return bool(folder) and os.access(folder, os.W_OK)


def _compile(module: Any) -> None:
    """Casts rays into an empty scene, which compiles the kernel or reads it from the cache."""
    nothing = np.zeros((0, 4), dtype=np.float32)
    surfaces = module.Surfaces(
        vertices_m=np.zeros((3, 0), dtype=np.float32),
        faces=np.zeros((0, 3), dtype=np.int32),
        clusters=np.zeros((0, 5), dtype=np.int32),
        spheres_m=nothing,
        ranges=np.zeros((0, 2), dtype=np.int32),
        bounds_m=nothing,
    )
    module.cast(
        surfaces,
        np.zeros((0, 2), dtype=np.int32),
        np.zeros((0, 3, 4), dtype=np.float32),
        module.Lens(*(1.0,) * 8),
        np.zeros((1, 1), dtype=np.float32),
        np.zeros((0, 0), dtype=np.int16),
    )
