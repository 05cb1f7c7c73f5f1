"""Loads the compiled kernel; numba compiles it once per machine, into the cache folder."""

from __future__ import annotations

import logging
import os
import shutil
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from hab_tasks.io.cache import writable_dir

logger = logging.getLogger(__name__)

FOLDER = "numba"


@lru_cache(maxsize=1)
def kernel() -> Any:
    """Returns the module `hab_tasks.world.raycast.kernel`, compiled.

    By default, numba writes compiled functions beside the source, which an installed package may
    forbid. They are written to ``NUMBA_CACHE_DIR`` if it is set, else to the cache folder.
    """
    # Takes a second, for images only.
    from numba.core import config as numba_config

    config: Any = numba_config
    before = config.CACHE_DIR
    folder = Path(before) if _is_writable(before) else writable_dir(FOLDER)
    config.CACHE_DIR = str(folder)
    try:
        module = import_module("hab_tasks.world.raycast.kernel")
    finally:
        config.CACHE_DIR = before  # it applies to the user's functions as well
    try:
        _compile(module)
    except Exception as error:  # a damaged entry raises anything that pickle raises
        logger.warning("%s: damaged cache entry (%s); it is recomputed.", folder, error)
        shutil.rmtree(module.cast.stats.cache_path, ignore_errors=True)
        _compile(module)
    return module


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
