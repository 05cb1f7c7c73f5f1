"""Provenance of a run: software versions, commit, machine, and the files of its agent.

An agent's code and declared weights are read, not imported, so that an isolated agent cannot change
what is said of it.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib
import os
import platform
import subprocess
import sys
import sysconfig
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import metadata, util
from importlib.machinery import ModuleSpec
from pathlib import Path

from hab_tasks.typed_values import Name

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
    for distribution in (name, f"{name}-nightly"):  # mani_skill-nightly is a ManiSkill, too
        with contextlib.suppress(metadata.PackageNotFoundError):
            return metadata.version(distribution)
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


@dataclass(frozen=True, kw_only=True)
class AgentFiles:
    """The files of an agent.

    Attributes:
        code: SHA-256 of the Python files of its package, or of those beside its module.
        git: Commit of these, with ``-dirty`` if one of them differs from it; None if they are in no
            repository.
        data: Name -> SHA-256 of the files in its spec and its options, e.g. weights. The name of a
            file in a package begins with the package's, ``hab_ppo/weights/pick_blind.safetensors``.
    """

    code: Name
    git: str | None
    data: dict[str, str]

    def resumed(self, now: AgentFiles) -> AgentFiles:
        """Returns what a run consists of that began with these files and goes on with `now`."""
        code = join_commits(self.code, now.code) or ""
        return replace(now, code=code, git=join_commits(self.git, now.git))


def agent_files(reference: str, paths: Sequence[str], options: Mapping[str, str]) -> AgentFiles:
    """Returns the files of an agent.

    Args:
        reference: ``module:factory``.
        paths: Files of its spec.
        options: Its options, of which some may be files.
    """
    search_here()
    sources = _sources(reference.partition(":")[0])
    found = [Path(one) for one in (*paths, *options.values())]
    data = {name_of(path.resolve()): _sha256([path]) for path in found if path.is_file()}
    return AgentFiles(
        code=_sha256(sources), git=commit_of(sources), data=dict(sorted(data.items()))
    )


def search_here() -> str:
    """Lets modules be found in the working directory; returns it."""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)  # last, so that local files do not shadow libraries
        importlib.invalidate_caches()
    return here


def no_longer_shipped(data: Mapping[str, str]) -> list[str]:
    """Returns the files of packages that are gone or have another content by now."""
    return [name for name, digest in data.items() if shipped_sha256(name) not in (None, digest)]


def shipped_sha256(name: str) -> str | None:
    """Returns the SHA-256 of a package's file, "" if it is gone; None if there is no package."""
    package, slash, rest = name.partition("/")
    folder = _package_folder(package) if slash else None
    if folder is None:
        return None
    path = folder / rest
    return _sha256([path]) if path.is_file() else ""


def name_of(path: Path) -> str:
    """Returns the name of a file: its path within the outermost package, else its last part."""
    packages = [folder for folder in path.parents if (folder / "__init__.py").is_file()]
    return path.relative_to(packages[-1].parent).as_posix() if packages else path.name


def _sources(module: str) -> list[Path]:
    """Returns the Python files of a module's top-level package, or those beside the module."""
    top = module.partition(".")[0]
    folder = _package_folder(top)
    if folder is not None:
        return sorted(folder.rglob("*.py"))
    spec = _find_spec(top)
    path = Path(spec.origin) if spec is not None and spec.origin is not None else Path()
    if not path.is_file():
        return []  # built in, or made by the agent itself
    installed = str(path.parent) in sysconfig.get_paths().values()
    return [path] if installed else sorted(path.parent.glob("*.py"))


def _package_folder(name: str) -> Path | None:
    """Returns the folder of a top-level package; None if there is none of this name."""
    spec = _find_spec(name)
    locations = [] if spec is None else list(spec.submodule_search_locations or [])
    return Path(locations[0]) if locations else None


def _find_spec(name: str) -> ModuleSpec | None:
    try:
        return util.find_spec(name)
    except ValueError:  # a module without a spec, such as __main__
        return None


def _sha256(paths: Sequence[Path]) -> str:
    """Returns the digest of one file's content, or of the names and contents of several."""
    digest = hashlib.sha256()
    for path in paths:
        content = path.read_bytes()
        if len(paths) > 1:
            digest.update(f"{path.name} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()
