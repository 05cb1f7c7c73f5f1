"""Provenance of a run: software versions, commit and machine."""

from __future__ import annotations

import functools
import os
import platform
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from importlib import metadata, util
from pathlib import Path

PACKAGES = ("hab-tasks", "hab-eval", "mani-skill", "sapien", "gymnasium", "torch", "numpy")


COMMIT_SEPARATOR = " then "


def join_commits(before: str | None, now: str | None) -> str | None:
    """Joins the commits on which a resumed run was made, in order."""
    if before is None and now is None:
        return None
    known = (before or "unknown").split(COMMIT_SEPARATOR)
    return COMMIT_SEPARATOR.join(dict.fromkeys([*known, now or "unknown"]))


def package_versions(agent: str) -> dict[str, str]:
    """Returns the versions of Python, the dependencies and the agent's distribution."""
    top_level = agent.partition(":")[0].partition(".")[0]
    owners = _distributions().get(top_level, [])
    names = dict.fromkeys([*PACKAGES, *owners])  # ordered, without duplicates
    return {"python": platform.python_version(), **{name: _version(name) for name in names}}


@functools.cache  # reads the file lists of all installed distributions
def _distributions() -> Mapping[str, list[str]]:
    return metadata.packages_distributions()


def git_commit() -> str | None:
    """Returns the commit of the `hab_tasks` sources, None outside a checkout."""
    spec = util.find_spec("hab_tasks")
    locations = list(spec.submodule_search_locations or []) if spec else []
    if not locations:
        return None
    folder = Path(locations[0])
    # An installed copy may be inside another checkout (e.g. its venv), which does not track it.
    if _git(folder, "ls-files", "--error-unmatch", "constants.py") is None:
        return None
    return _git(folder, "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")


def commit_of(files: Sequence[Path]) -> str | None:
    """Returns the commit of files of one folder, with ``-dirty`` if one of them differs from it.

    Returns:
        None if they are in no repository, or installed into one that does not track them.
    """
    if not files:
        return None
    ask = partial(_git, files[0].parent)
    names = [str(path) for path in files]
    tracked = ask("ls-files", "--", *names)
    changed = ask("status", "--porcelain", "--untracked-files=all", "--", *names)
    commit = ask("rev-parse", "HEAD")
    if commit is None or not (tracked or changed):
        return None
    return f"{commit}-dirty" if changed else commit


def device() -> str:
    """Returns the models of processor and graphics card."""
    import torch  # tables and help texts start without it

    parts = [_processor(), f"{os.cpu_count()} cores"]
    if torch.cuda.is_available():
        parts.append(torch.cuda.get_device_name(0))
    return ", ".join(parts)


def _version(name: str) -> str:
    # The metadata of an editable install keeps the version of the day of its set-up.
    own = getattr(sys.modules.get(name.replace("-", "_")), "__version__", None)
    if own is not None and name.startswith("hab-"):
        return str(own)
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


def _processor() -> str:
    """Returns the processor's model; `platform` lacks it on Linux."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


def _git(folder: Path, *arguments: str) -> str | None:
    """Returns the output of a git command, None if it fails or git is not installed."""
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *arguments],
            capture_output=True,
            text=True,
            check=True,
            timeout=20,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
