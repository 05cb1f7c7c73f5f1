"""The page of all environments that `hab-tasks docs` writes, made from their classes."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import fields

import torch

from hab_tasks.commands.environment_pictures import FRAMES_PICTURE, picture_name
from hab_tasks.constants import CAMERA_DEPTH_MAX_M, CAMERA_SIZE_PX, EE_STEP_M, JOINT_STEP_RAD
from hab_tasks.envs import ENVS, EnvEntry
from hab_tasks.instructions import task_sentence
from hab_tasks.measures import MEANINGS, Measures
from hab_tasks.robots.control import HabControllerConfig, control_configs
from hab_tasks.robots.control_modes import (
    ARM_SIZE,
    BASE_CELLS,
    BASE_SIZE,
    STOP_CELL,
    STOP_SHARE,
)
from hab_tasks.robots.fetch_spec import BASE_ANGULAR_SPEED_RAD_S, BASE_LINEAR_SPEED_M_S
from hab_tasks.sensors import ObsEntry
from hab_tasks.skills.base import SkillEnv
from hab_tasks.skills.hab_env import HabEnv
from hab_tasks.tasks.task_env import SHOWN, TaskEnv

PAGE = "environments.md"

SCORES = {
    "sct": ("1", "success weighted by completion time, at most 1"),
    "spl": ("1", "success weighted by path length, at most 1"),
}
"""Measures that a skill adds -> unit and meaning."""

ARM_MEANINGS = {
    "ee": f"displacement of the end-effector in the base frame, 1 is {EE_STEP_M} m",
    "joint_delta": f"displacement of the arm joints' targets, 1 is {JOINT_STEP_RAD} rad",
    "joint_target": "targets of the arm joints [rad]",
    "joint_state": "positions of the arm joints [rad], set at once",
}

INTRODUCTION = f"""\
# Environments

Made by `hab-tasks docs --out docs` from the classes themselves; change them, not this page.

Every environment takes the same options (`scene_dataset`, `split`, `cameras`, ...; see the
[README](../README.md)) and plays at 30 actions a second. `info` holds `success`, `fail`,
`failures`, `measures` and `reward_terms`, whose sum is the reward; tasks add `stages` and `part`.
`obs_mode` is `state`, `state_dict`, `depth`, `rgb`, `rgb+depth` or `pointcloud`; `reward_mode` is
`dense`, `normalized_dense` (divided by the largest reward of a step, and clipped at 1), `sparse` or
`none`. [notation.md](notation.md) has the paper's symbols, [deviations.md](deviations.md) every
departure from the paper. S is the paper's supplement. In the base frame x is ahead, y to the left,
z up; in the hand's frame x points out of the hand.

## Frames

Of the observation's groups, `agent` is what the robot feels of itself, `extra` what it is told, and
`sensor_data` the images. Below, the start of an episode of `HabPick-v1`: the base frame on the
floor, the hand's frame at the end-effector, and the way from there to the target.

![The base frame, the hand's frame, and the vector to the target]({FRAMES_PICTURE})

Actions of `ee` move the end-effector along the axes of the base frame. `object_start_from_ee`,
`object_goal_from_ee`, `handle_from_ee` and `rest_from_ee` are what is left of the way, along the
same axes: in free space their direction is that of the action. Added to `ee_position`, each gives
a point in the base frame. `ee_rotation` is the first column of the rotation matrix base_from_ee,
followed by the second; the third is their cross product. That matrix transposed, times
`object_start_from_ee`, is the target in the hand's frame, which `target_frame="ee"` puts in its
place, as in Habitat.

Navigate and the tasks are told points in the base frame itself; `targets_in_base` and
`handles_in_base` less `ee_position` are what a skill is told. Objects' points are where they were
when the episode began, or where they are to be; handles' are where they are now.
"""


def page() -> str:
    """Returns the page about every registered environment."""
    contents = _table(("environment", "task", "longest episode"), map(_row, ENVS.values()))
    return "\n".join([INTRODUCTION, contents, *(_section(entry) for entry in ENVS.values())])


def _row(entry: EnvEntry) -> tuple[str, ...]:
    name = f"[`{entry.id}`](#{entry.id.lower()})"
    return name, task_sentence(entry.env), f"{entry.horizon_steps} steps"


def _section(entry: EnvEntry) -> str:
    """Returns what the page says of one environment."""
    env, parts = entry.env, _parts(entry.env)
    observed = [*map(_observed, env.observation), _cameras(env)]
    modes = [(f"`{m}`", *_action(control_configs()[m])) for m in env.control_modes]
    measured = [(f"`{name}`", *meaning) for name, meaning in measures_of(env).items()]
    lines = [
        f"\n## {entry.id}\n",
        f"{parts['Task']}\n",
        f"![{entry.id}: the robot at the start, and what its head camera sees]"
        f"({picture_name(entry.id)})\n",
        _paragraph("Start", parts["Start"]),
        _paragraph("Observation", parts["Observation"]),
        _table(("entry", "group", "shape", "unit", "meaning"), observed),
        *_on_request(env),
        _paragraph("Action", parts["Action"]),
        _table(("control mode", "entries", "meaning"), modes),
        _paragraph("Reward", parts["Reward"]),
        *_weights(env),
        *(_paragraph(name, parts[name]) for name in ("Stages",) if name in parts),
        *(_paragraph(name, parts[name]) for name in ("Success", "Failure", "Horizon")),
        _paragraph("Measures", '(in `info["measures"]`)'),
        _table(("name", "unit", "meaning"), measured),
        _paragraph("Versions", parts["Versions"]),
    ]
    return "\n".join(lines)


def measures_of(env: type[HabEnv]) -> dict[str, tuple[str, str]]:
    """Returns name -> unit and meaning of everything in ``info["measures"]``."""
    if issubclass(env, TaskEnv):
        return {name: MEANINGS[name] for name in SHOWN}
    assert issubclass(env, SkillEnv)
    zeros = Measures(**dict.fromkeys(MEANINGS, torch.zeros(1)))
    added = env.skill.scores(zeros, torch.zeros(1, dtype=torch.bool))
    return {name: MEANINGS[name] for name in env.skill.measures} | {n: SCORES[n] for n in added}


def _weights(env: type[HabEnv]) -> list[str]:
    """Returns the weights of a skill's reward in a line."""
    if not issubclass(env, SkillEnv):
        return []
    weights = env.skill.config.weights
    said = (f"`{f.name}` {getattr(weights, f.name):g}" for f in fields(weights))
    return [_paragraph("Weights", f"{', '.join(said)}.")]


def _observed(entry: ObsEntry) -> tuple[str, ...]:
    """Returns the table's row of an entry."""
    shape = "x".join(map(str, entry.shape))
    return f"`{entry.name}`", f"`{entry.group}`", shape, entry.unit, entry.meaning


def _on_request(env: type[HabEnv]) -> list[str]:
    """Returns the table of the entries that options bring; nothing where there are none."""
    rows = [
        (f'`target_frame="ee"`, instead of `{entry.name}`', *_observed(entry.in_ee))
        for entry in env.observation
        if entry.in_ee is not None
    ]
    if env.handle is not None:
        rows.append(("`handle_position=True`", *_observed(env.handle)))
    return [_table(("option", "entry", "group", "shape", "unit", "meaning"), rows)] if rows else []


def _cameras(env: type[HabEnv]) -> tuple[str, ...]:
    """Returns the table's row of the images."""
    names = ", ".join(f"`{name}`" for name in env.cameras)
    size = f"{CAMERA_SIZE_PX} x {CAMERA_SIZE_PX}"
    meaning = f"`depth` (1 at {CAMERA_DEPTH_MAX_M:g} m) or `rgb` of these cameras"
    return names, "`sensor_data`", size, "0 to 1 or 255", meaning


def _action(config: HabControllerConfig) -> tuple[str, str]:
    """Returns the entries of a control mode's action, and what they mean."""
    speeds = f"1 is {BASE_LINEAR_SPEED_M_S:g} m/s and {BASE_ANGULAR_SPEED_RAD_S:g} rad/s"
    if config.base == "discrete":
        linear, angular = (_numbers(sorted({cell[i] for cell in BASE_CELLS})) for i in (0, 1))
        cells = f"forward {linear}, and for each of them turning {angular}"
        return f"0 to {len(BASE_CELLS) - 1}", f"{cells}; {speeds}; {STOP_CELL} is the stop action"
    said: list[tuple[int, str]] = []
    if config.arm != "still":
        said.append((ARM_SIZE[config.arm], ARM_MEANINGS[config.arm]))
        said.append((1, "gripper, >= 0 grasps, < 0 releases"))
    if config.base == "velocity":
        said.append((BASE_SIZE["velocity"], f"base, forward and turning velocity, {speeds}"))
    if config.base == "pose":
        said.append(
            (BASE_SIZE["pose"], "base, x and y [m] and yaw [rad] in the world, set at once")
        )
    if config.arm == "still":
        said[-1] = (2, f"{said[-1][1]}; both within {STOP_SHARE:g} of 0 is the stop action")
    return " + ".join(str(n) for n, _ in said), "; ".join(meaning for _, meaning in said)


def _parts(env: type[HabEnv]) -> dict[str, str]:
    """Returns the marked parts of a class's docstring in Markdown, the first sentence as `Task`."""
    text = textwrap.dedent(f"    {env.__doc__}").replace("``", "`")
    first, *marked = re.split(r"\*\*(\w+)\*\*", text)
    found = dict(zip(marked[::2], marked[1::2], strict=True))
    # The page has tables of its own.
    head, *_, tail = re.split(r"^ *=====.*$", found["Observation"], flags=re.MULTILINE)
    found["Observation"] = f"{head.strip().removesuffix(':')}. {tail}"
    found["Action"] = found["Action"].partition("(`hab_tasks.robots.control`). ")[2]
    return {"Task": _flat(first)} | {name: _flat(part) for name, part in found.items()}


def _flat(text: str) -> str:
    return " ".join(text.split()).removeprefix(": ").replace("128²", "128 x 128")


def _paragraph(name: str, text: str) -> str:
    return f"**{name}**{' ' if text.startswith('(') else ': '}{text}".rstrip() + "\n"


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
