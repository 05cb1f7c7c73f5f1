"""Writes the results site."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from hab_eval.errors import ResultError
from hab_eval.records.leaderboard import default_submissions, read_submissions
from hab_eval.records.plain_text import plain
from hab_eval.records.results import RunRecord, read_runs
from hab_eval.records.status import best_rows
from hab_eval.site.agents import Card, agent_pages, read_cards, read_studies
from hab_eval.site.breakdown import Receptacles, read_receptacles
from hab_eval.site.comparison import comparison_sets
from hab_eval.site.datasets import dataset_pages
from hab_eval.site.entries import Entry, make_entries
from hab_eval.site.media import (
    MarkdownFile,
    copy_file,
    copy_video,
    find_folders,
    videos_in,
    views_in,
    write_picture,
)
from hab_eval.site.pages import Page, Site, all_pages
from hab_tasks.errors import OptionError
from hab_tasks.io.files import check_folder, folder_written_aside

MARK = "site.json"
"""File by which `--force` recognises a site."""

STATIC = ("static/site.css", "static/site.js", "static/compare.js")
LIBRARIES = (
    "vendor/list.js/list.min.js",
    "vendor/list.js/LICENSE",
    "vendor/chartist/chartist.umd.js",
    "vendor/chartist/chartist.css",
    "vendor/chartist/LICENSE",
)


@dataclass(frozen=True, kw_only=True)
class SiteOptions:
    """Sources of the site, and where it is written.

    Attributes:
        out: Output folder.
        runs: Folders of runs, instead of submissions and videos.
        submissions: Folder of submissions; None for the checkout's.
        videos: Folder of videos and pages in 3-D; None for neither.
        checkout: Checkout with figures, model cards and episode files; None for this one.
        force: Replace an existing site.
    """

    out: Path
    runs: Sequence[Path] = ()
    submissions: Path | None = None
    videos: Path | None = None
    checkout: Path | None = None
    force: bool = False


def build_site(options: SiteOptions) -> int:
    """Writes the site atomically; returns the number of pages.

    Raises:
        HabError: A source cannot be read, or the folder may not be replaced.
    """
    check_folder(options.out, force=options.force, mark=MARK)
    site = _read(options)
    pages = all_pages(site)
    with folder_written_aside(options.out) as folder:
        write_pages(folder, pages)
        _write_static(folder)
        _write_pictures(folder, site)
        for entry in site.entries:
            for video in site.videos.get(entry.name, ()):
                copy_video(video, folder / "videos" / entry.slug / video.file.name)
            for view in site.views.get(entry.name, ()):
                copy_file(view.file, folder / "views" / entry.slug / view.file.name)
        manifest = {"pages": [page.path for page in pages]}
        (folder / MARK).write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")
    return len(pages)


def write_pages(folder: Path, pages: Sequence[Page]) -> None:
    """Writes pages to a folder."""
    environment = make_environment()
    for page in pages:
        target = folder / page.path
        target.parent.mkdir(parents=True, exist_ok=True)
        root = "../" * page.path.count("/")
        context = {**page.context, "data": plain_values(page.data), "root": root, "page": page}
        text = environment.get_template(page.template).render(context)
        target.write_text(text, encoding="utf-8")


def make_environment() -> Environment:
    """Returns the template environment: all values are escaped and on one line."""
    environment = Environment(
        loader=PackageLoader("hab_eval.site"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_plain_value,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "sort_keys": False}
    return environment


def plain_values(value: Any) -> Any:
    """Escapes non-printable characters in the text of JSON values."""
    if isinstance(value, str):
        return plain(value)
    if isinstance(value, dict):
        return {plain(key): plain_values(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain_values(item) for item in value]
    return value


def _plain_value(value: Any) -> Any:
    return plain(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def _read(options: SiteOptions) -> Site:
    """Reads all sources."""
    checkout = options.checkout or Path(__file__).resolve().parents[3]
    if not os.path.isdir(checkout):  # unlike Path.is_dir, False for an invalid name
        raise OptionError(f"--checkout {checkout}: not a folder; give a clone of the repository.")
    records, folders_of = _runs(options) if options.runs else _submissions(options)
    entries = make_entries(records)
    folders = folders_of(entries)
    by_folder = [(entry, folders[entry.name]) for entry in entries if entry.name in folders]
    cards: Sequence[Card] = read_cards(checkout)
    episodes = checkout / "assets" / "episodes"
    return Site(
        entries=entries,
        sets=comparison_sets(entries),
        agents=agent_pages(entries, cards),
        datasets=dataset_pages(entries, checkout / "docs"),
        studies=read_studies(checkout),
        receptacles=read_receptacles(episodes) if episodes.is_dir() else Receptacles(),
        videos={entry.name: videos_in(folder, entry) for entry, folder in by_folder},
        views={entry.name: views_in(folder, entry) for entry, folder in by_folder},
        docs=checkout / "docs",
        best=best_rows(records),
    )


Folders = Callable[[Sequence[Entry]], dict[str, Path]]


def _submissions(options: SiteOptions) -> tuple[dict[str, RunRecord], Folders]:
    folder = options.submissions or default_submissions()
    found = read_submissions(folder)
    if not found:
        raise ResultError(f"{folder}: no submissions; hab-eval submit adds one.")
    return found, partial(find_folders, options.videos)


def _runs(options: SiteOptions) -> tuple[dict[str, RunRecord], Folders]:
    """Returns runs as submissions, by the names of their folders."""
    if options.submissions or options.videos:
        raise OptionError("give runs, or --submissions and --videos, not both.")
    folders = [path.parent if path.name == "run.json" else path for path in options.runs]
    names = [folder.resolve().name for folder in folders]
    if twice := {name for name in names if names.count(name) > 1}:
        raise OptionError(f"two runs are named {min(twice)!r}; rename one of the folders.")
    records = {f"{n}.json": run for n, run in zip(names, read_runs(folders), strict=True)}
    by_name = dict(zip(names, folders, strict=True))
    return records, lambda entries: {entry.name: by_name[entry.name] for entry in entries}


def _write_static(folder: Path) -> None:
    """Copies style sheets and scripts."""
    package = resources.files("hab_eval.site")
    for name in (*STATIC, *LIBRARIES):
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(package.joinpath(name).read_bytes())


def _write_pictures(folder: Path, site: Site) -> None:
    for dataset in site.datasets:
        for figure in dataset.figures:
            write_picture(site.docs / figure.file, folder / "datasets" / figure.picture)
    for agent in site.agents:
        if agent.card is not None:
            _write_pictures_of(agent.card.file, folder / "agents" / agent.slug)
    for study in site.studies:
        _write_pictures_of(study.file, folder / "studies" / study.slug)


def _write_pictures_of(file: MarkdownFile, folder: Path) -> None:
    for name in file.pictures:
        write_picture(file.path.parent / name, folder / f"{Path(name).stem}.webp")
