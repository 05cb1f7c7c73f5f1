"""`hab-tasks docs`: the page of all environments, and a picture of each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_tasks.commands.base import Command, refuse_existing
from hab_tasks.errors import HabError
from hab_tasks.registration import ENTRY_POINTS


@dataclass(frozen=True, kw_only=True)
class Docs(Command):
    """Options of `hab-tasks docs`."""

    help: ClassVar[
        str
    ] = """Writes environments.md: every environment with its spaces, rewards and ends.

Example:
  hab-tasks docs --out docs --pictures --force"""

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder of the page; made when absent."""
    pictures: bool = False
    """Draw the frames as well, and env_<id>.png of each: the room beside the head camera's view."""
    force: bool = False
    """Replace files in DIR."""

    def run(self) -> int:
        """Writes the page, then the pictures."""
        from PIL import Image

        from hab_tasks.commands.environment_pictures import (
            FRAMES_PICTURE,
            draw_frames_picture,
            picture,
            picture_name,
        )
        from hab_tasks.commands.environments_page import PAGE, page
        from hab_tasks.rendering import resolve_backend

        files = [self.out / PAGE]
        if self.pictures:
            resolve_backend("auto", wants_images=True)
            files += [
                self.out / name for name in (*map(picture_name, ENTRY_POINTS), FRAMES_PICTURE)
            ]
        for file in files:
            refuse_existing(file, self.force)
        try:
            self.out.mkdir(parents=True, exist_ok=True)
            _write(files[0], page().encode())
            for file, env_id in zip(files[1:], ENTRY_POINTS, strict=False):
                scratch = file.with_name(f"partial_{file.name}")
                Image.fromarray(picture(env_id)).save(scratch)
                scratch.replace(file)
            if self.pictures:
                draw_frames_picture(files[-1])
        except OSError as error:
            raise HabError(f"{self.out}: cannot be written ({error}).") from error
        for file in files:
            print(f"wrote {file}")
        return 0


def _write(file: Path, content: bytes) -> None:
    scratch = file.with_name(f"partial_{file.name}")
    scratch.write_bytes(content)
    scratch.replace(file)
