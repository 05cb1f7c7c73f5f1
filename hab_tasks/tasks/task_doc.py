"""Generates the docstring of a task's environment class from its declaration."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from hab_tasks.engine.sensors import ObsEntry
from hab_tasks.receptacles import OPEN_RECEPTACLES, PHRASES
from hab_tasks.task_order import interactions
from hab_tasks.task_spec import ARTICULATIONS, TaskSpec

WIDTH = 96

OBSERVATION = (
    "**Observation** (``state_dict``: ``agent`` and ``extra``; ``state`` is their concatenation):"
)
IMAGES = ("head, arm", "sensor_data", "128²", "0..1", "depth, 1 at 10 m; uint8 with ``rgb``")
ACTION = (
    "**Action**: ``ee_base`` 3 + 1 + 2; ``joint_delta_base``, ``joint_target_base`` and "
    "``joint_state_base`` 7 + 1 + 2; ``joint_target_pose`` and ``joint_state_pose`` 7 + 1 + 3 "
    "(`hab_tasks.robots.control`)."
)


def docstring(spec: TaskSpec, observation: Sequence[ObsEntry]) -> str:
    """Returns the docstring of a task's environment class.

    Args:
        spec: The task.
        observation: Entries of the state observation.
    """
    order = interactions(spec)
    skills = listed([item.stage.replace("_", " ") if item.kind in ("open", "close") else item.kind
                     for item in order])  # fmt: skip
    stages = ", ".join(f"``{item.stage}``" for item in order)
    ends = f", {listed(spec.ends_closed)} closed" if spec.ends_closed else ""
    parts = (
        spec.instruction,
        f"**Start**: {_start(spec)}",
        OBSERVATION,
        _table(observation),
        ACTION,
        '**Reward** (terms in ``info["reward_terms"]``, named ``skill/term``): those of the '
        "current skill; a drop takes back what the grasp has paid. "
        f"Skill order, each preceded by navigate: {skills} (S H.3).",
        f"**Stages**: {stages}, in this order (S G.2).",
        f"**Success**: every object released and at rest within 0.15 m of its goal{ends}.",
        "**Failure**: none; contact forces are not limited.",
        f"**Horizon**: {spec.horizon_steps:,} steps. "
        f"**Versions**: {_version(spec)}, initial version.",
    )
    return "\n\n".join(part if "\n" in part else _wrapped(part) for part in parts) + "\n"


def listed(words: Sequence[str]) -> str:
    """Joins words with commas, and "and" before the last."""
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def _table(observation: Sequence[ObsEntry]) -> str:
    """Returns the observation table."""
    entries = (
        (e.name, e.group, "x".join(map(str, e.shape)), e.unit, e.meaning) for e in observation
    )
    rows = [("entry", "group", "shape", "unit", "meaning"), *entries, IMAGES]
    widths = [max(len(row[column]) for row in rows) for column in range(5)]
    rule = "  ".join("=" * width for width in widths)
    lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
    return "\n".join([rule, lines[0], rule, *lines[1:], rule])


def _start(spec: TaskSpec) -> str:
    count, open_, closed = len(spec.targets), spec.starts_open, _closed(spec)
    doors = [f"{listed(open_)} open"] if open_ else []
    doors += [f"{listed(closed)} closed"] if closed else []
    objects = "one object" if count == 1 else f"{count} objects"
    hidden = " Objects behind a closed door or in a closed drawer cannot be grasped."
    return (
        f"{objects} to rearrange and {spec.clutter} others {listed(_places(spec.clutter_on))}; "
        f"{', '.join(doors)}; the robot at a random free pose with random heading (S G.1)."
        f"{hidden if spec.articulations else ''}"
    )


def _places(names: tuple[str, ...]) -> tuple[str, ...]:
    """Returns the clutter receptacles in words; the open receptacles under one name."""
    usual = set(OPEN_RECEPTACLES) <= set(names)
    others = [name for name in names if not (usual and name in OPEN_RECEPTACLES)]
    found = tuple(dict.fromkeys(PHRASES[name] for name in others))
    return ("on the open receptacles", *found) if usual else found


def _closed(spec: TaskSpec) -> tuple[str, ...]:
    return tuple(name for name in ARTICULATIONS if name not in spec.starts_open)


def _version(spec: TaskSpec) -> str:
    return spec.id.rpartition("-")[2]


def _wrapped(text: str) -> str:
    return textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False)
