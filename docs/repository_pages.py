"""MkDocs hook: shows READMEs of the repository as pages, and links to its other files.

Links in Markdown files are relative to the file, so that they work in the repository too. A link
to a file that is part of the site becomes a link to its page; any other file of the repository is
linked at `extra.repository`.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
DOCS = "docs"
CARDS = tuple(f"baselines/ppo/hab_ppo/{name}" for name in ("weights", "navigation", "language"))
"""Folders with model cards and their pictures."""

STUDIES = "eval/studies"
"""A folder for each study, with its page and pictures."""

PAGES = {
    "eval/README.md": "packages/eval.md",
    "eval/lerobot_env_hab/README.md": "packages/lerobot.md",
    "eval/leaderboard/LEADERBOARD.md": "packages/leaderboard.md",
    "baselines/spa/README.md": "packages/spa.md",
    "baselines/plans/README.md": "packages/plans.md",
    "baselines/experts/README.md": "packages/experts.md",
    "baselines/navigator/README.md": "packages/navigator.md",
    "baselines/ppo/README.md": "packages/ppo.md",
    "baselines/tp_srl/README.md": "packages/tp_srl.md",
    "assets/README.md": "packages/apartment.md",
    "assets/LICENSES.md": "packages/licences.md",
    "CONTRIBUTING.md": "packages/contributing.md",
    "CHANGELOG.md": "packages/changelog.md",
}
PAGES |= {
    file.relative_to(ROOT).as_posix(): f"packages/policies/{file.name}"
    for folder in CARDS
    for file in sorted((ROOT / folder).iterdir())
    if file.suffix in (".md", ".png")
}
PAGES |= {
    file.relative_to(ROOT).as_posix(): f"packages/studies/{file.parent.name}/{file.name}"
    for file in sorted((ROOT / STUDIES).glob("*/*"))
    if file.suffix in (".md", ".png")
}
"""File of the repository -> page of the site, or its picture; model cards, then studies."""

SOURCES = {page: file for file, page in PAGES.items()}
HOME = {"README.md": "index.md"}
"""The README has a home page of its own on the site."""

LINK = re.compile(r"(?<=\]\()(?P<path>[^)#\s]+)(?P<rest>#[^)\s]*)?(?=\))")
VIDEO = re.compile(r'<p><a href="(?P<file>[^"]+\.mp4)">(?P<text>[^<]*)</a></p>')
CODE = re.compile(r"(^```.*?^```|`[^`\n]+`)", re.MULTILINE | re.DOTALL)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages that lie outside the folder of the documentation."""
    for source, page in PAGES.items():
        files.append(File.generated(config, page, abs_src_path=str(ROOT / source)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Rewrites the links of a page.

    Raises:
        PluginError: A link leads to no file.
    """
    own = page.file.src_uri
    source = SOURCES.get(own, f"{DOCS}/{own}")
    parts = CODE.split(markdown)  # text and code alternate
    parts[::2] = [_relinked(part, own, source, config) for part in parts[::2]]
    return "".join(parts)


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Shows the video of a paragraph that is only a link to one."""
    return VIDEO.sub(
        r'<figure><video controls muted preload="none" src="\g<file>" aria-label="\g<text>" '
        r'style="width: 100%; aspect-ratio: 1536 / 680"></video>'
        r"<figcaption>\g<text></figcaption></figure>",
        html,
    )


def _relinked(text: str, own: str, source: str, config: MkDocsConfig) -> str:
    def link(match: re.Match[str]) -> str:
        path, rest = match["path"], match["rest"] or ""
        if "://" in path or path.startswith("mailto:"):
            return match[0]
        target = posixpath.normpath(posixpath.join(posixpath.dirname(source), path))
        known = PAGES | HOME
        if target in known:
            return posixpath.relpath(known[target], posixpath.dirname(own) or ".") + rest
        file = ROOT / target
        if not file.exists():
            raise PluginError(f"{source}: there is no {path}.")
        if target.startswith(f"{DOCS}/"):
            page = target.removeprefix(f"{DOCS}/")
            return posixpath.relpath(page, posixpath.dirname(own) or ".") + rest
        kind = "tree" if file.is_dir() else "blob"
        return f"{config.extra['repository']}/{kind}/main/{target}{rest}"

    return LINK.sub(link, text)
