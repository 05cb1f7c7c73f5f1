"""Download of ReplicaCAD and YCB with ManiSkill; only on explicit request."""

from __future__ import annotations

from pathlib import Path

from mani_skill import ASSET_DIR
from mani_skill.utils import download_asset

from hab_tasks.errors import HabError
from hab_tasks.world.scenes.habitat.dataset import MANISKILL_ASSETS, maniskill_folder


def fetch(asset: str) -> Path:
    """Returns the folder of a ManiSkill asset (``ReplicaCAD``, ``ycb``), downloaded if absent.

    Raises:
        HabError: The download failed, or the folder has other content.
    """
    subfolder, part = MANISKILL_ASSETS[asset]
    folder = ASSET_DIR / subfolder
    if (folder / part).is_dir():
        return folder
    if folder.is_dir() and any(folder.iterdir()):
        raise HabError(
            f"{folder}: not empty, but has no {part}/. ManiSkill would delete its content before "
            f"downloading {asset}; move it away first."
        )
    try:
        download_asset.download(download_asset.DATA_SOURCES[asset], non_interactive=True)
    except (OSError, ValueError) as error:
        raise HabError(f"{asset} could not be downloaded to {folder}: {error}") from error
    return maniskill_folder(asset)
