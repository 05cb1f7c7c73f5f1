"""ManiSkill's own download of ReplicaCAD and YCB, when a user asks for it and never otherwise."""

from __future__ import annotations

from pathlib import Path

from mani_skill import ASSET_DIR

from hab_tasks.errors import HabError
from hab_tasks.scenes.dataset import MANISKILL_ASSETS, maniskill_folder


def fetch(asset: str) -> Path:
    """Returns the folder of a ManiSkill asset (``ReplicaCAD``, ``ycb``), downloaded if absent.

    Raises:
        HabError: The download failed, or something else is in its place.
    """
    place, part = MANISKILL_ASSETS[asset]
    folder = ASSET_DIR / place
    if (folder / part).is_dir():
        return folder
    if folder.is_dir() and any(folder.iterdir()):
        raise HabError(
            f"{folder}: holds something, but no {part}/. ManiSkill would delete it before it "
            f"downloads {asset}: move it away first."
        )
    # Only here: the import needs seconds, and nothing else may be able to download.
    from mani_skill.utils import download_asset

    try:
        download_asset.download(download_asset.DATA_SOURCES[asset], non_interactive=True)
    except (OSError, ValueError) as error:
        raise HabError(f"{asset} could not be downloaded to {folder}: {error}") from error
    return maniskill_folder(asset)
