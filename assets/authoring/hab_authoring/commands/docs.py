"""`hab-tasks docs`: the reference page of all environments, and an image of each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_tasks.console import Command
from hab_tasks.files import check_file, written_aside
from hab_tasks.registration import ENTRY_POINTS


@dataclass(frozen=True, kw_only=True)
class Docs(Command):
    """Options of `hab-tasks docs`."""

    help: ClassVar[
        str
    ] = """Writes environments.md: spaces, rewards and termination of every environment.

Example:
  hab-tasks docs --out docs --pictures --force"""

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Output folder; created if absent."""
    pictures: bool = False
    """Also draw the frames, and env_<id>.png of each: the scene beside the head camera's view."""
    force: bool = False
    """Replace files in DIR."""

    def run(self) -> int:
        """Writes the page, then the images."""
        from PIL import Image

        from hab_authoring.commands.environment_pictures import (
            FRAMES_PICTURE,
            draw_frames_picture,
            picture,
            picture_name,
        )
        from hab_authoring.commands.environments_page import PAGE, page
        from hab_tasks.rendering import resolve_backend

        files = [self.out / PAGE]
        if self.pictures:
            resolve_backend("auto", wants_images=True)
            files += [
                self.out / name for name in (*map(picture_name, ENTRY_POINTS), FRAMES_PICTURE)
            ]
        for file in files:
            check_file(file, force=self.force)
        with written_aside(files[0]) as scratch:
            scratch.write_text(page(), encoding="utf-8")
        for file, env_id in zip(files[1:], ENTRY_POINTS, strict=False):
            with written_aside(file) as scratch:
                Image.fromarray(picture(env_id)).save(scratch)
        if self.pictures:
            draw_frames_picture(files[-1])
        for file in files:
            print(f"wrote {file}")
        return 0
