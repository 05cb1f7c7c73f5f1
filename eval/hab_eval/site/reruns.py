"""The commands and the facts that are needed to rerun a submission."""

from __future__ import annotations

import shlex
from collections.abc import Collection

from hab_eval.records.commands import command_of, dataset_options, vary_command
from hab_eval.records.provenance import COMMIT_SEPARATOR
from hab_eval.records.results import RunRecord
from hab_eval.site.entries import OTHER_KIND, Entry

WEIGHT_OPTIONS = ("weights", "policy", "checkpoint")
"""Agent options that name a file of weights."""

DATASET_NOTE = "PATH is the folder that contains the dataset on your machine."


def command_lines(entry: Entry) -> list[str]:
    """Returns the commands that repeat a run: commit, wild layouts if needed, `hab-eval run`."""
    commit, vary = entry.record.git, vary_command(entry.record.scene_dataset)
    lines = [] if commit is None else [f"git checkout {shlex.quote(_last_commit(commit))}"]
    return [*lines, *([vary] if vary else []), run_command(entry)]


def run_command(entry: Entry) -> str:
    """Returns the `hab-eval run` command of a submission."""
    return f"{command_of(entry.record)} --out runs/{shlex.quote(entry.slug)}"


def verify_command(entry: Entry) -> str:
    """Returns the `hab-eval verify` command of a submission."""
    words = ["hab-eval", "verify", entry.name, "--episodes", "10"]
    return shlex.join([*words, *dataset_options(entry.record)])


def needs_path(record: RunRecord) -> bool:
    """Returns whether the commands contain the path of a dataset that is not shipped."""
    return "PATH/" in " ".join([*dataset_options(record), vary_command(record.scene_dataset)])


def weights_of(record: RunRecord, kinds: Collection[str]) -> str:
    """Describes the weights of a run's agent."""
    given = [f"{name}={record.options[name]}" for name in WEIGHT_OPTIONS if name in record.options]
    if given:
        return ", ".join(given)
    if "learned" in kinds:
        module, _, factory = record.agent.partition(":")
        return f"{factory}, shipped with {module} at this commit"
    return "unknown" if OTHER_KIND in kinds else "none"


def facts_of(entry: Entry) -> list[tuple[str, str]]:
    """Returns (name, value) of everything that a rerun depends on."""
    record = entry.record
    versions = ", ".join(f"{name} {version}" for name, version in record.versions.items())
    facts = [
        ("commit", record.git or "unknown"),
        ("seed", str(record.seed)),
        ("split", record.split),
        ("weights", weights_of(record, entry.kinds)),
        *_file_facts(record),
        ("versions", versions),
        ("machine", record.device),
        ("control mode", record.control_mode),
        ("observations", record.obs_mode),
    ]
    facts += [("options", ", ".join(entry.variants))] if entry.variants else []
    if record.step_timeout_s is not None:
        facts.append(("time limit per call", f"{record.step_timeout_s:g} s"))
    return facts


def _file_facts(record: RunRecord) -> list[tuple[str, str]]:
    """Returns the digests of the agent's files, and whether it was isolated."""
    files = record.agent_files
    if files is None:
        return []
    where = f"commit {files.git}" if files.git else "in no repository"
    data = [(f"SHA-256 of {name}", digest) for name, digest in files.data.items()]
    isolated = "yes" if record.isolated else "no"
    return [("agent's code", f"SHA-256 {files.code}, {where}"), *data, ("isolated", isolated)]


def _last_commit(git: str) -> str:
    """Returns the commit to check out: of several the last, without ``-dirty``."""
    return git.split(COMMIT_SEPARATOR)[-1].removesuffix("-dirty")
