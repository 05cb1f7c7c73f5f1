"""On what a run was made: versions, commit, machine."""

from __future__ import annotations

import os
import platform
import subprocess
from importlib import metadata, util
from pathlib import Path

import torch

PACKAGES = ("hab-tasks", "hab-eval", "mani-skill", "sapien", "gymnasium", "torch", "numpy")


def package_versions(agent: str) -> dict[str, str]:
    """Returns the versions of Python, the stack and the distribution that holds the agent."""
    top_level = agent.partition(":")[0].partition(".")[0]
    owners = metadata.packages_distributions().get(top_level, [])
    names = dict.fromkeys([*PACKAGES, *owners])  # keeps the order, drops what appears twice
    return {"python": platform.python_version(), **{name: _version(name) for name in names}}


def git_commit() -> str | None:
    """Returns the commit of the `hab_tasks` sources, None if they are not in a checkout."""
    spec = util.find_spec("hab_tasks")
    locations = list(spec.submodule_search_locations or []) if spec else []
    if not locations:
        return None
    folder = Path(locations[0])
    # An installed copy may lie in somebody else's checkout (a venv): ask whether git tracks it.
    if _git(folder, "ls-files", "--error-unmatch", "constants.py") is None:
        return None
    return _git(folder, "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")


def device() -> str:
    """Returns the processor and graphics card in words."""
    parts = [_processor(), f"{os.cpu_count()} cores"]
    if torch.cuda.is_available():
        parts.append(torch.cuda.get_device_name(0))
    return ", ".join(parts)


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


def _processor() -> str:
    """Returns the processor's model; Linux does not tell it through `platform`."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


def _git(folder: Path, *arguments: str) -> str | None:
    """Returns the output of a git command, None if it fails or there is no git."""
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
