"""Worker of the Ray executor: an actor that does one job after another."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from hab_tasks.errors import HabError, reported

PACKAGES = ("hab-tasks", "mani-skill", "sapien", "torch", "numpy")
"""Packages whose versions affect results."""


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Process that started the workers: package -> version, working directory, module path."""

    versions: Mapping[str, str]
    folder: str
    path: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class Done:
    """Result of a job; `value` is None after the start."""

    value: Any = None


@dataclass(frozen=True, kw_only=True)
class Failed:
    """Error of a job, or of the start of a worker."""

    error: HabError


def this_origin() -> Origin:
    """Returns the origin of workers that this process starts."""
    return Origin(versions=_versions(), folder=os.getcwd(), path=tuple(sys.path))


class JobWorker:
    """Does jobs; errors are returned, because Ray would wrap them."""

    def start(
        self, origin: Origin, start: Callable[..., Callable[[Any], Any]], arguments: tuple[Any, ...]
    ) -> Done | Failed:
        """Prepares this process and calls the task's `start`."""
        try:
            _adopt(origin)
            # Loads torch, which only a worker with the versions and path of its origin should.
            from hab_tasks.io.threads import use_one_thread

            use_one_thread()
            self._work = start(*arguments)
        except Exception as error:
            return Failed(error=reported("A worker could not start", error))
        return Done()

    def work(self, name: str, job: Any) -> Done | Failed:
        """Does a job; `name` is for messages."""
        try:
            return Done(value=self._work(job))
        except Exception as error:
            return Failed(error=reported(f"{name} stopped the run", error))


def _adopt(origin: Origin) -> None:
    """Takes over the working directory and the search path; checks the versions."""
    sys.path.extend(folder for folder in origin.path if folder not in sys.path)
    if os.path.isdir(origin.folder):
        os.chdir(origin.folder)
    here = _versions()
    different = [
        f"{name} {here[name]} instead of {wanted}"
        for name, wanted in origin.versions.items()
        if here[name] != wanted
    ]
    if different:
        raise HabError(
            f"Node {os.uname().nodename} has {', '.join(different)}; install the same versions on "
            "all nodes."
        )


def _versions() -> dict[str, str]:
    return {name: _version(name) for name in PACKAGES}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "missing"
