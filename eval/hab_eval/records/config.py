"""Evaluation configuration (`config.json`): every option that affects the results."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path

from hab_eval.errors import ResultError
from hab_eval.records.provenance import AgentFiles, join_commits
from hab_eval.records.schema import parse_json, read_dataclass
from hab_tasks.errors import OptionError, shown
from hab_tasks.io.files import written_aside
from hab_tasks.option_values import whole
from hab_tasks.robots import DEFAULT_ROBOT
from hab_tasks.robots.spec import robot_of, robot_reference, with_grasp
from hab_tasks.typed_values import LARGEST_INT, is_text

MOST_EPISODES = 100_000
"""All episodes of a run are kept in memory, 10 to 20 kB each."""

EMBEDDED_DATASET = "apartment"
"""Name of the shipped scene dataset."""

LEAST_TIMEOUT_S, MOST_TIMEOUT_S = 0.01, 86400.0


@dataclass(frozen=True, kw_only=True)
class EvalConfig:
    """Options that affect the results of a run; workers and videos are in `RunOptions`.

    Attributes:
        agent: ``module:factory``.
        env: Environment id, e.g. ``HabPick-v1``.
        scene_dataset: ``apartment`` or the path of a ReplicaCAD folder.
        objects: Path of a YCB folder, None for the shipped objects.
        split: Episode split, None for the dataset's evaluation split.
        episodes: Number of episodes.
        seed: Seed of the episode set and of the agent.
        novel: Held-out ``objects`` or ``receptacles``, to evaluate generalization (S E.1).
        options: Agent options, name -> value; absent in older files.
        skill_config: Reward weights and thresholds that replace the skills' defaults,
            name -> number; absent in older files.
        env_options: Options of the environment that differ from the protocol, name -> value, e.g.
            ``sensor_noise.joint_rad``; absent in older files.
        step_timeout_s: Time limit for one call of the agent [s]; None for no limit.
        isolated: Whether the agent runs in processes of its own; absent in older files.
        instructions: Wording of the instructions, ``fixed`` or ``varied``.
    """

    agent: str
    env: str
    scene_dataset: str = EMBEDDED_DATASET
    objects: str | None = None
    split: str | None = None
    episodes: int = 50
    seed: int = 0
    novel: str | None = None
    options: dict[str, str] = field(default_factory=dict)
    skill_config: dict[str, float] = field(default_factory=dict)
    env_options: dict[str, str] = field(default_factory=dict)
    step_timeout_s: float | None = None
    isolated: bool = False
    instructions: str = "fixed"

    def __post_init__(self) -> None:
        whole("episodes", self.episodes, 1, MOST_EPISODES)
        whole("seed", self.seed, 0, LARGEST_INT)
        if self.step_timeout_s is not None:
            _check_timeout(self.step_timeout_s)
        texts = {f.name: getattr(self, f.name) for f in fields(self)}
        options = [*self.options.items(), *self.env_options.items()]
        texts |= {f"option {shown(name)}": f"{name}={value}" for name, value in options}
        for name, text in texts.items():
            if isinstance(text, str) and not is_text(text):
                raise OptionError(f"{name} is {shown(text)}, which is not valid UTF-8 text.")


@dataclass(frozen=True, kw_only=True)
class SavedConfig:
    """Content of `config.json`: the configuration, software versions and the agent's files."""

    config: EvalConfig
    versions: dict[str, str]
    git: str | None
    agent_files: AgentFiles

    def resumed(self, now: SavedConfig) -> SavedConfig:
        """Returns what describes a run that began with this and goes on with `now`."""
        return replace(
            now,
            git=join_commits(self.git, now.git),
            agent_files=self.agent_files.resumed(now.agent_files),
        )


def _check_timeout(timeout_s: float) -> None:
    if not LEAST_TIMEOUT_S <= timeout_s <= MOST_TIMEOUT_S:
        valid = f"from {LEAST_TIMEOUT_S} to {MOST_TIMEOUT_S} seconds"
        raise OptionError.of_value("step-timeout", timeout_s, valid)


def parse_options(pairs: Iterable[str], option: str = "--option") -> dict[str, str]:
    """Parses ``NAME=VALUE`` pairs of a command-line option, sorted by name.

    Raises:
        OptionError: A malformed pair or a duplicate name.
    """
    found: dict[str, str] = {}
    for pair in pairs:
        name, equals, value = pair.partition("=")
        if not (name and equals and value):
            raise OptionError(f"{option} {pair!r} is not of the form NAME=VALUE.")
        if name in found:
            raise OptionError(f"{option} {name} is given twice: {found[name]!r} and {value!r}.")
        found[name] = value
    return dict(sorted(found.items()))


def parse_numbers(pairs: Iterable[str]) -> dict[str, float]:
    """Parses ``NAME=NUMBER`` pairs, sorted by name.

    Raises:
        OptionError: A malformed pair, a duplicate name, or a number that is not finite.
    """
    found: dict[str, float] = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (name and equals and math.isfinite(value)):
            raise OptionError(f"--skill-config {pair!r} is not of the form NAME=NUMBER.")
        if name in found:
            raise OptionError(f"--skill-config {name} is given twice.")
        found[name] = value
    return dict(sorted(found.items()))


def write_config(path: Path, saved: SavedConfig) -> None:
    """Writes `config.json` atomically."""
    with written_aside(path) as scratch:
        scratch.write_text(json.dumps(asdict(saved), indent=2) + "\n", encoding="utf-8")


def read_config(path: Path) -> SavedConfig:
    """Reads and validates `config.json`."""
    if not path.is_file():
        raise ResultError(f"{path}: not found, so there is no run to resume.")
    return read_dataclass(SavedConfig, parse_json(path), where=str(path))


def describe_difference(old: SavedConfig, new: SavedConfig) -> str | None:
    """Describes the differences that forbid resuming `old` as `new`; None if there are none."""
    found = [
        f"{field.name}: {getattr(old.config, field.name)!r} before, "
        f"{getattr(new.config, field.name)!r} now"
        for field in fields(EvalConfig)
        if getattr(old.config, field.name) != getattr(new.config, field.name)
    ]
    names = sorted(old.versions.keys() | new.versions.keys())
    found += [
        f"version of {name}: {old.versions.get(name)} before, {new.versions.get(name)} now"
        for name in names
        if old.versions.get(name) != new.versions.get(name)
    ]
    old_data, new_data = old.agent_files.data, new.agent_files.data
    found += [
        f"the agent's file {name} has changed"
        for name in sorted(old_data.keys() | new_data.keys())
        if old_data.get(name) != new_data.get(name)
    ]
    return "; ".join(found) or None


def short_name(dataset: str) -> str:
    """Returns a dataset's name without its parent folders, which differ between machines."""
    return Path(dataset).name or dataset


def robot_asked(env_options: Mapping[str, str]) -> str | None:
    """Returns the `robot_reference` of the options ``robot`` and ``grasp``; None without them.

    Raises:
        UnknownNameError: There is no such robot, or it has no such grasp.
    """
    uid, grasp = env_options.get("robot"), env_options.get("grasp")
    if uid is None and grasp is None:
        return None
    return robot_reference(with_grasp(robot_of(uid or DEFAULT_ROBOT.uid), grasp))
