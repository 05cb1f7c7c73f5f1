"""`hab-tasks docs`: the reference page of all environments, and an image of each."""

from __future__ import annotations

from PIL import Image

from hab_authoring.commands.environment_pictures import (
    FRAMES_PICTURE,
    draw_frames_picture,
    picture,
    picture_name,
)
from hab_authoring.commands.environments_page import PAGE, page
from hab_authoring.commands.options import Docs
from hab_tasks.io.files import check_file, written_aside
from hab_tasks.registration import ENTRY_POINTS
from hab_tasks.rendering import resolve_backend


def run(options: Docs) -> int:
    """Writes the page, then the images."""
    files = [options.out / PAGE]
    if options.pictures:
        resolve_backend("auto", wants_images=True)
        files += [options.out / name for name in (*map(picture_name, ENTRY_POINTS), FRAMES_PICTURE)]
    for file in files:
        check_file(file, force=options.force)
    with written_aside(files[0]) as scratch:
        scratch.write_text(page(), encoding="utf-8")
    for file, env_id in zip(files[1:], ENTRY_POINTS, strict=False):
        with written_aside(file) as scratch:
            Image.fromarray(picture(env_id)).save(scratch)
    if options.pictures:
        draw_frames_picture(files[-1])
    for file in files:
        print(f"wrote {file}")
    return 0
