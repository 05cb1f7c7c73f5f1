"""Submissions as the site shows them: order, page names, kinds of agents, what a rerun needs."""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath

from hab_eval.records import paper
from hab_eval.records.leaderboard import (
    FEW_EPISODES,
    command_of,
    dataset_options,
    scenes_of,
    variants_of,
    vary_command,
)
from hab_eval.records.provenance import COMMIT_SEPARATOR
from hab_eval.records.results import UNSAFE, RunRecord
from hab_eval.records.stats import mean
from hab_eval.records.status import REMOTE
from hab_tasks.registration import ENTRY_POINTS

LONGEST_SLUG = 120

KINDS = {
    "hab_ppo": "learned",
    "hab_tp_srl": "learned",
    "hab_spa": "planned",
    "hab_eval": "scripted",
}
"""Top-level module of an agent -> kind of agent."""

OTHER_KIND = "other"
REFERENCE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A submission.

    Attributes:
        name: File name without ``.json``.
        slug: The name as part of file names and links.
        record: The result.
        kinds: Kinds of the agent and of agents named in its options: ``learned``, ...
    """

    name: str
    slug: str
    record: RunRecord
    kinds: tuple[str, ...]

    @property
    def scenes(self) -> str:
        """Scene dataset and objects."""
        return scenes_of(self.record)

    @property
    def few(self) -> bool:
        """Whether the run has fewer episodes than a submission should have."""
        return len(self.record.episodes) < FEW_EPISODES

    @property
    def variants(self) -> tuple[str, ...]:
        """Options of the agent and of the skill that differ from the defaults."""
        return tuple(variants_of(self.record))

    @property
    def stages(self) -> tuple[str, ...]:
        """Names of a task's stages, in order; () for a skill."""
        # An episode that never started has no stages.
        return next((tuple(one.stages) for one in self.record.episodes if one.stages), ())

    @property
    def scores(self) -> list[tuple[str, float]]:
        """Names and means of a skill's scores, such as SCT; [] without."""
        return [(name, score.mean) for name, score in self.record.summary.scores.items()]

    @property
    def stage_mean(self) -> float:
        """Mean rate of the stages; -1 for a skill."""
        rates = [estimate.mean for estimate in self.record.summary.stages.values()]
        return mean(rates) if rates else -1.0


def make_entries(records: Mapping[str, RunRecord]) -> list[Entry]:
    """Returns the submissions by environment, dataset, success, agent, seed and name."""
    names = sorted(records)
    slugs = unique_slugs(PurePath(name).stem for name in names)
    entries = [
        Entry(
            name=PurePath(name).stem,
            slug=slug,
            record=records[name],
            kinds=kinds_of(records[name]),
        )
        for name, slug in zip(names, slugs, strict=True)
    ]
    return sorted(entries, key=_rank)


def unique_slugs(names: Iterable[str]) -> list[str]:
    """Returns a file name for each name, unique also where upper and lower case are the same."""
    taken: set[str] = set()
    slugs = []
    for name in names:
        base = UNSAFE.sub("-", name).strip("-.")[:LONGEST_SLUG] or "unnamed"
        slug, number = base, 1
        while slug.lower() in taken:
            number += 1
            slug = f"{base}-{number}"
        taken.add(slug.lower())
        slugs.append(slug)
    return slugs


def kinds_of(record: RunRecord) -> tuple[str, ...]:
    """Returns the kinds of a run's agent, and of the agents that its options name."""
    named = [value for value in record.options.values() if REFERENCE.fullmatch(value)]
    modules = [reference.partition(":")[0].partition(".")[0] for reference in named]
    module = record.agent.partition(":")[0].partition(".")[0]
    own = OTHER_KIND if record.agent == REMOTE else KINDS.get(module, OTHER_KIND)
    return tuple(sorted({own, *(KINDS[name] for name in modules if name in KINDS)}))


def env_rank(env: str) -> tuple[int, str]:
    """Sorts environments in the order of the registry, others last."""
    order = {env_id: number for number, env_id in enumerate(ENTRY_POINTS)}
    return order.get(env, len(order)), env


def dataset_rank(scenes: str) -> tuple[bool, str]:
    """Sorts datasets by name, wild layouts last."""
    return "wild" in scenes, scenes


def _rank(entry: Entry) -> tuple[object, ...]:
    record = entry.record
    return (
        env_rank(record.env),
        dataset_rank(entry.scenes),
        -record.summary.success.mean,
        record.agent_name,
        record.seed,
        entry.name,
    )


def counterparts(result: paper.PaperResult, entries: Sequence[Entry]) -> list[Entry]:
    """Returns the submissions of a method on the same protocol, with default options."""
    scene_dataset, objects, splits = paper.PROTOCOLS[result.layouts]
    return [
        entry
        for entry in entries
        if entry.record.agent == result.agent
        and entry.record.env == paper.ENV
        and entry.record.scene_dataset == scene_dataset
        and entry.record.objects == objects
        and entry.record.split in splits
        and not entry.variants
    ]


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
