"""Finds and runs the installed suites."""

from __future__ import annotations

from importlib.metadata import entry_points

from hab_eval.bench.layout import check_scenes
from hab_eval.bench.options import BenchOptions
from hab_eval.bench.rows import BenchRow
from hab_eval.bench.suite import GROUP, Suite, WriteLine
from hab_eval.errors import BenchError
from hab_eval.run import environments
from hab_tasks.errors import UnknownNameError


def suite_names() -> list[str]:
    """Returns the names of all installed suites."""
    return sorted(entry_points(group=GROUP).names)


def find_suite(name: str) -> Suite:
    """Returns a suite.

    Raises:
        UnknownNameError: No installed package has a suite of this name.
        BenchError: The suite cannot be imported.
    """
    found = [entry for entry in entry_points(group=GROUP) if entry.name == name]
    if not found:
        raise UnknownNameError("suite", name, suite_names())
    try:
        return found[0].load()
    except (ImportError, AttributeError) as error:
        raise BenchError(f"Suite {name} ({found[0].value}) cannot be loaded: {error}.") from error


def run_suite(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Runs one suite, after checking scenes and environments."""
    check_scenes(options.scene_dataset, {scene for group in options.groups for scene in group})
    for env_id in options.envs:
        environments.check_env_id(env_id)
    return options.suite.run(options, write_line)
