"""The files that an agent consists of: its code, and the weights that it declares.

They are read, not imported, so that an isolated agent cannot change what is said of it.
"""

from __future__ import annotations

import hashlib
import importlib
import sys
import sysconfig
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import util
from importlib.machinery import ModuleSpec
from pathlib import Path

from hab_eval.records.provenance import commit_of, join_commits
from hab_tasks.typed_values import Name


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
