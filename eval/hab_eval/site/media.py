"""Pictures, videos, pages in 3-D and Markdown files (model cards, studies) of the site."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlsplit

from markdown_it import MarkdownIt
from markdown_it.token import Token
from markupsafe import Markup
from PIL import Image

from hab_eval.errors import ResultError
from hab_eval.records.results import video_name
from hab_eval.site.entries import Entry
from hab_tasks.errors import OptionError

PICTURE_WIDTH_PX = 1200
POSTER_WIDTH_PX = 640
QUALITY = 80
VIDEO = re.compile(r"video_(\d+)_.*\.mp4")
VIEW = re.compile(r"view_(\d+)\.html")


@dataclass(frozen=True, kw_only=True)
class Video:
    """A video of an episode: its file, and its first frame if there is one."""

    index: int
    file: Path
    poster: Path | None


@dataclass(frozen=True, kw_only=True)
class View:
    """A page of an episode in 3-D, as `hab-eval view` writes it."""

    index: int
    file: Path
    size_mb: float


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


def find_folders(folder: Path | None, entries: Sequence[Entry]) -> dict[str, Path]:
    """Returns the folder of videos and pages of each submission, by its name.

    Args:
        folder: Has a folder with the name of each submission, with files as written by
            `hab-eval film`, `hab-eval run --video` and `hab-eval view`; None for no videos.
        entries: The submissions.

    Raises:
        OptionError: A folder belongs to no submission.
    """
    if folder is None:
        return {}
    if not os.path.isdir(folder):  # unlike Path.is_dir, False for an invalid name
        raise OptionError(f"--videos {folder}: not a folder; hab-eval film writes one.")
    found = {path.name: path for path in sorted(folder.glob("[!.]*")) if path.is_dir()}
    for name in found.keys() - {entry.name for entry in entries}:
        raise OptionError(f"--videos {folder}: no submission is named {name!r}.")
    return found


def videos_in(folder: Path, entry: Entry) -> list[Video]:
    """Returns the videos in the folder of a run.

    Raises:
        OptionError: One belongs to no episode.
    """
    return [_video(path, entry) for path in sorted(folder.glob("video_*.mp4"))]


def views_in(folder: Path, entry: Entry) -> list[View]:
    """Returns the pages in 3-D in the folder of a run.

    Raises:
        OptionError: One belongs to no episode.
    """
    found = [(path, VIEW.fullmatch(path.name)) for path in sorted(folder.glob("view_*.html"))]
    views = []
    for path, match in found:
        count = len(entry.record.episodes)
        if match is None or int(match[1]) >= count:
            raise OptionError(f"{path}: {entry.name} has the episodes view_0 to view_{count - 1}.")
        size_mb = path.stat().st_size / 1e6
        views.append(View(index=int(match[1]), file=path, size_mb=size_mb))
    return sorted(views, key=lambda view: view.index)


def copy_video(video: Video, target: Path) -> None:
    """Copies a video and its first frame, the latter as WebP."""
    copy_file(video.file, target)
    if video.poster is not None:
        write_picture(video.poster, target.with_suffix(".webp"), POSTER_WIDTH_PX)


def copy_file(source: Path, target: Path) -> None:
    """Copies a file to a folder that may not exist yet."""
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, target)


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


PICTURE_TYPES = {".png", ".jpg", ".jpeg", ".webp"}


@dataclass(frozen=True, kw_only=True)
class MarkdownFile:
    """A Markdown file; pictures that it shows are beside it."""

    path: Path
    text: str

    @property
    def pictures(self) -> list[str]:
        """Names of the pictures that it shows."""
        return list(dict.fromkeys(rendered(self, "")[1]))


def read_markdown(path: Path) -> MarkdownFile:
    """Reads a Markdown file.

    Raises:
        ResultError: It cannot be read.
    """
    try:
        return MarkdownFile(path=path, text=path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ResultError(f"{path}: cannot be read: {error}") from error


def title_of(file: MarkdownFile) -> str:
    """Returns the heading in the first line; the name of the folder without one."""
    first = file.text.partition("\n")[0]
    return first.removeprefix("# ").strip() if first.startswith("# ") else file.path.parent.name


def rendered(file: MarkdownFile, folder: str) -> tuple[Markup, list[str]]:
    """Returns the HTML of a file, and the names of the pictures beside it that it shows.

    The page, which has its own title, finds the pictures in `folder`, as WebP.

    Raw HTML is shown as text. Other pictures are left out, so that a page loads nothing from a
    network, and relative links become text, because the site does not contain their targets.
    """
    parser = MarkdownIt("commonmark", {"html": False}).enable(["table", "strikethrough"])
    tokens = _without_title(parser.parse(file.text))
    pictures: list[str] = []
    for token in tokens:
        _lower_heading(token)
        for child in token.children or []:
            if child.type == "image":
                _localize(child, file.path.parent, folder, pictures)
        if token.children:
            token.children = _without_relative_links(token.children)
    return Markup(parser.renderer.render(tokens, parser.options, {})), pictures


def _without_title(tokens: list[Token]) -> list[Token]:
    """Removes a heading of the first level at the start."""
    is_title = bool(tokens) and tokens[0].type == "heading_open" and tokens[0].tag == "h1"
    return tokens[3:] if is_title else tokens  # opening, text, closing


def _lower_heading(token: Token) -> None:
    """Moves headings down by one level; the page has its own title."""
    if token.type in ("heading_open", "heading_close"):
        token.tag = f"h{min(6, int(token.tag[1:]) + 1)}"


def _localize(image: Token, beside: Path, folder: str, pictures: list[str]) -> None:
    """Points an image to its copy in the site, or turns it into text."""
    name = unquote(str(image.attrs.get("src", "")))
    is_beside = name == Path(name).name and (beside / name).is_file()
    if is_beside and Path(name).suffix.lower() in PICTURE_TYPES:
        pictures.append(name)
        image.attrs["src"] = f"{folder}/{Path(name).stem}.webp"
        image.attrs["loading"] = "lazy"
    else:
        image.type, image.tag, image.nesting = "text", "", 0


def _without_relative_links(children: list[Token]) -> list[Token]:
    kept, dropped = [], 0
    for child in children:
        if child.type == "link_open":
            if urlsplit(str(child.attrs.get("href", ""))).scheme in ("http", "https"):
                child.attrs["rel"] = "noreferrer"
            else:
                dropped += 1
                continue
        elif child.type == "link_close" and dropped:
            dropped -= 1
            continue
        kept.append(child)
    return kept
