"""The command `hab-eval site`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from hab_tasks.console import Command

SITE_HELP = """Generates the results site, a folder of static pages, from the submissions.

Example:
  hab-eval site --out site
  python -m http.server --directory site

The pages load nothing from a network and also work when opened as files. --videos adds videos,
as recorded by hab-eval film: DIR/<submission>/video_<index>_<episode id>.mp4."""


@dataclass(frozen=True, kw_only=True)
class SiteCommand(Command):
    """Options of `hab-eval site`."""

    help: ClassVar[str] = SITE_HELP

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Output folder."""
    submissions: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of submitted run.json files; this checkout's if not given."""
    videos: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of recorded videos, with a folder per submission."""
    checkout: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Checkout with the datasets' figures (docs), model cards (baselines) and episode files
    (assets/episodes); this one if not given."""
    force: bool = False
    """Replace the site in DIR."""

    def run(self) -> int:
        """Writes the site."""
        from hab_eval.site.build import SiteOptions, build_site

        options = SiteOptions(
            out=self.out,
            submissions=self.submissions,
            videos=self.videos,
            checkout=self.checkout,
            force=self.force,
        )
        pages = build_site(options)
        print(f"wrote {pages} pages; open {self.out / 'index.html'}")
        return 0
