"""Pictures and videos of the site."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from hab_eval.errors import ResultError
from hab_eval.records.video_names import video_name
from hab_eval.site.entries import Entry
from hab_tasks.errors import OptionError

PICTURE_WIDTH_PX = 1200
POSTER_WIDTH_PX = 640
QUALITY = 80
VIDEO = re.compile(r"video_(\d+)_.*\.mp4")


@dataclass(frozen=True, kw_only=True)
class Video:
    """A video of an episode: its file, and its first frame if there is one."""

    index: int
    file: Path
    poster: Path | None


def write_picture(source: Path, target: Path, width_px: int = PICTURE_WIDTH_PX) -> None:
    """Writes a picture as WebP, at most `width_px` wide.

    Raises:
        ResultError: It is not a picture.
    """
    try:
        with Image.open(source) as image:
            picture = image.convert("RGB")
    except OSError as error:
        raise ResultError(f"{source}: cannot be read as a picture: {error}") from error
    if picture.width > width_px:
        height = max(1, round(picture.height * width_px / picture.width))
        picture = picture.resize((width_px, height), Image.Resampling.LANCZOS)
    target.parent.mkdir(parents=True, exist_ok=True)
    picture.save(target, "WEBP", quality=QUALITY)


def find_videos(folder: Path | None, entries: Sequence[Entry]) -> dict[str, list[Video]]:
    """Returns the videos of each submission, by its name.

    Args:
        folder: Has a folder with the name of each submission, with files as written by
            `hab-eval film` and `hab-eval run --video`; None for no videos.
        entries: The submissions.

    Raises:
        OptionError: A folder or a video belongs to no submission or episode.
    """
    if folder is None:
        return {}
    if not os.path.isdir(folder):  # unlike Path.is_dir, False for an invalid name
        raise OptionError(f"--videos {folder}: not a folder; hab-eval film writes one.")
    by_name = {entry.name: entry for entry in entries}
    found: dict[str, list[Video]] = {}
    for path in sorted(folder.glob("*/*.mp4")):
        if path.name.startswith(".") or path.parent.name.startswith("."):
            continue  # a video that is being recorded
        entry = by_name.get(path.parent.name)
        if entry is None:
            raise OptionError(f"--videos {folder}: no submission is named {path.parent.name!r}.")
        found.setdefault(entry.name, []).append(_video(path, entry))
    return found


def copy_video(video: Video, target: Path) -> None:
    """Copies a video and its first frame, the latter as WebP."""
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(video.file, target)
    if video.poster is not None:
        write_picture(video.poster, target.with_suffix(".webp"), POSTER_WIDTH_PX)


def _video(path: Path, entry: Entry) -> Video:
    match = VIDEO.fullmatch(path.name)
    index = int(match[1]) if match else -1
    episodes = entry.record.episodes
    if not 0 <= index < len(episodes) or path.stem != video_name(index, episodes[index].id):
        wanted = f"{video_name(0, episodes[0].id)}.mp4"
        raise OptionError(
            f"{path}: not the name of an episode's video of {entry.name}, such as {wanted}."
        )
    poster = path.with_suffix(".png")
    return Video(index=index, file=path, poster=poster if poster.is_file() else None)
