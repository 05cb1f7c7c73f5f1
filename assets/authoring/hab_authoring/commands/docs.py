"""`hab-tasks docs`: the reference page of environments, and images of each and of the frames."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from PIL import Image

from hab_authoring.commands import contract
from hab_authoring.commands.options import Docs
from hab_authoring.figures.frames import Arrow, Frame, draw_frames, photo_of
from hab_tasks.constants import CAMERA_DEPTH_MAX_M, CAMERA_SIZE_PX, EE_STEP_M, JOINT_STEP_RAD
from hab_tasks.engine.hab_env import HabEnv
from hab_tasks.engine.measures import MEANINGS
from hab_tasks.engine.sensors import OBJECT_START, ObsEntry
from hab_tasks.engine.skill_env import SkillEnv
from hab_tasks.envs import ENVS, EnvEntry
from hab_tasks.io.files import check_file, written_aside
from hab_tasks.registration import ENTRY_POINTS
from hab_tasks.rendering import resolve_backend
from hab_tasks.robots import DEFAULT_ROBOT
from hab_tasks.robots.control import HabControllerConfig, control_configs
from hab_tasks.robots.control_modes import (
    BASE_CELLS,
    BASE_SIZE,
    STOP_CELL,
    STOP_SHARE,
)
from hab_tasks.tasks.task_env import TaskEnv
from hab_tasks.tasks.task_rules import SHOWN


def run(options: Docs) -> int:
    """Writes the pages and the recorded episode, then the images."""
    pages = [options.out / name for name in (PAGE, contract.PAGE, contract.EPISODE_FILE)]
    files = list(pages)
    if options.pictures:
        resolve_backend("auto", wants_images=True)
        files += [options.out / name for name in (*map(picture_name, ENTRY_POINTS), FRAMES_PICTURE)]
    for file in files:
        check_file(file, force=options.force)
    for file, text in zip(pages, (page(), contract.page()), strict=False):
        with written_aside(file) as scratch:
            scratch.write_text(text, encoding="utf-8")
    with written_aside(pages[-1]) as scratch:
        contract.write_golden(scratch)
    for file, env_id in zip(files[len(pages) :], ENTRY_POINTS, strict=False):
        with written_aside(file) as scratch:
            Image.fromarray(picture(env_id)).save(scratch)
    if options.pictures:
        draw_frames_picture(files[-1])
    for file in files:
        print(f"wrote {file}")
    return 0


FRAMES_PICTURE = "frames.png"
PICTURE_PX = 512

EPISODES = {
    "HabTidyHouse-v1": 1,
    "HabNavigate-v1": 4,
    "HabPrepareGroceries-v1": 3,
    "HabSetTable-v1": 4,
}
"""Environment -> episode of its image; the first one by default."""

FRAMES_EPISODE = 18
FRAMES_VIEW_M = (1.0, 2.3, 1.35), (0.4, 0.0, 0.6)
"""Camera position and look-at point of the frames image, in the base frame."""


def picture_name(env_id: str) -> str:
    """Returns the file name of an environment's image."""
    return f"env_{env_id}.png"


def picture(env_id: str) -> np.ndarray:
    """Returns the start of an episode, (H, 2 W, 3) uint8: the scene, and the head camera's view."""
    env = gym.make(env_id, obs_mode="rgb", render_mode="rgb_array", camera_size_px=PICTURE_PX)
    try:
        obs, _ = env.reset(seed=0, options={"episode": EPISODES.get(env_id, 0)})
        room: Any = env.render()
        views = room[0], obs["sensor_data"]["head"]["rgb"][0]
        return np.concatenate([np.asarray(v.cpu(), dtype=np.uint8) for v in views], axis=1)
    finally:
        env.close()


def draw_frames_picture(file: Path) -> None:
    """Draws base frame, end-effector frame and target at the start of an episode of Pick."""
    env = gym.make("HabPick-v1", obs_mode="state", render_mode="rgb_array")
    try:
        env.reset(seed=0, options={"episode": FRAMES_EPISODE})
        base: Any = env.unwrapped
        now = base.simulation.snapshot
        world_from_base, world_from_ee = np.eye(4), np.eye(4)
        world_from_base[:3, :3], world_from_base[:2, 3] = now.base_axes[0], now.base[0, :2]
        world_from_ee[:3, :3], world_from_ee[:3, 3] = now.ee_axes[0], now.ee_m[0]
        eye_m, at_m = ((world_from_base @ (*point, 1.0))[:3] for point in FRAMES_VIEW_M)
        target_m = now.objects_m[0, 0].astype(float)
        draw_frames(
            file,
            photo_of(base.scene.sub_scenes[0], eye_m, at_m),
            (
                Frame(name="base frame", world_from_frame=world_from_base, length_m=0.4),
                Frame(name="hand's frame", world_from_frame=world_from_ee, length_m=0.2),
            ),
            (Arrow(name=OBJECT_START.name, start_m=world_from_ee[:3, 3], end_m=target_m),),
        )
    finally:
        env.close()


PAGE = "environments.md"

FILMED = (
    *("HabPick-v1", "HabPlace-v1", "HabOpenFridge-v1", "HabCloseFridge-v1", "HabOpenDrawer-v1"),
    *("HabCloseDrawer-v1", "HabNavigate-v1"),
    *("HabTidyHouse-v1", "HabPrepareGroceries-v1", "HabSetTable-v1"),
)
"""Environments with a video beside the page; docs/film_environments.py makes them."""

SCORES = {
    "sct": ("1", "success weighted by completion time, at most 1"),
    "spl": ("1", "success weighted by path length, at most 1"),
}
"""Additional measures of skills -> (unit, meaning)."""

ARM_MEANINGS = {
    "ee": f"end-effector displacement in the base frame (1 = {EE_STEP_M} m)",
    "joint_delta": f"displacement of the joint targets (1 = {JOINT_STEP_RAD} rad)",
    "joint_target": "joint targets [rad]",
    "joint_state": "joint positions [rad], set directly",
    "still": "-",
}
BASE_MEANINGS = {
    "still": "-",
    "velocity": "velocities",
    "pose": "pose, set directly",
    "discrete": "one of the velocity cells",
}

INTRODUCTION = """\
# Environments

All environments run at 30 actions per second and accept the same [options](options.md). S is the
supplement of the Habitat 2.0 paper; [Notation](notation.md) maps its symbols to the code,
[Deviations](deviations.md) lists every deviation from it.

- `info` contains `success`, `fail`, `failures`, `measures` and `reward_terms`, whose sum is the
  reward. Tasks add `stages` and `part`.
- `obs_mode` is `state`, `state_dict`, `depth`, `rgb`, `rgb+depth` or `pointcloud`.
- `reward_mode` is `dense`, `normalized_dense` (divided by the maximum reward per step and clipped
  at 1), `sparse` or `none`.

This page is generated by `hab-tasks docs --out docs`; edit the classes, not this page.
"""

FRAMES = f"""
## Frames

In the base frame, x points forward, y left and z up; in the end-effector frame, x points along the
gripper.

![Base frame, end-effector frame, and the vector to the target]({FRAMES_PICTURE})

Actions of `ee` move the end-effector along the axes of the base frame. `object_start_from_ee`,
`object_goal_from_ee`, `handle_from_ee` and `rest_from_ee` are the remaining displacements along the
same axes; adding `ee_position` gives a point in the base frame. Navigate and the tasks observe
points in the base frame: subtracting `ee_position` gives the displacements that a skill observes.
Object positions are initial or goal positions, handle positions are current.

`ee_rotation` holds the first two columns of the rotation matrix base_from_ee. The transpose of that
matrix times `object_start_from_ee` is the target in the end-effector frame, which
`target_frame="ee"` observes instead, as in Habitat.
"""

OBSERVATIONS = """
## Observations

`state_dict` has the groups `agent` (proprioception) and `extra` (task); `state` is their
concatenation. Image modes add `sensor_data`.
"""

ACTIONS = """
## Actions

The entries of arm, gripper and base follow one another.
"""


def page() -> str:
    """Returns the documentation of all registered environments in Markdown."""
    contents = ", ".join(f"[`{env_id}`](#{env_id.lower()})" for env_id in ENVS)
    common = (FRAMES, OBSERVATIONS, _observations(), ACTIONS, *_actions(), _measures())
    sections = (_section(entry) for entry in ENVS.values())
    return "\n".join([INTRODUCTION, textwrap.fill(contents, 100), *common, *sections])


def _section(entry: EnvEntry) -> str:
    """Returns the section of one environment."""
    env, parts = entry.env, _parts(entry.env)
    speed = ", eight times as fast" if issubclass(env, TaskEnv) else ""
    video = f"[Video{speed}: head camera, arm camera, room]({video_name(entry.id)})\n"
    lines = [
        f"\n## {entry.id}\n",
        f"{parts['Task']}\n",
        f"![{entry.id}: initial state and head camera]({picture_name(entry.id)})\n",
        *([video] if entry.id in FILMED else []),
        _paragraph("Start", parts["Start"]),
        _paragraph("Observation", f"{_observed(env)} {parts['Observation']}"),
        _paragraph("Action", f"{_names(env.control_modes)}. {parts['Action']}"),
        _paragraph("Reward", parts["Reward"]),
        *_weights(env),
        *(_paragraph(name, parts[name]) for name in ("Stages",) if name in parts),
        *(_paragraph(name, parts[name]) for name in ("Success", "Failure", "Horizon")),
        _paragraph("Measures", f"{_names(measures_of(env))}."),
    ]
    if not parts["Versions"].endswith("v1, initial version."):
        lines.append(_paragraph("Versions", parts["Versions"]))
    return "\n".join(lines)


def video_name(env_id: str) -> str:
    """Returns the path of an environment's video, from the page."""
    return f"videos/{env_id}.mp4"


def measures_of(env: type[HabEnv]) -> dict[str, tuple[str, str]]:
    """Returns name -> (unit, meaning) of all entries of ``info["measures"]``."""
    if issubclass(env, TaskEnv):
        return {name: MEANINGS[name] for name in SHOWN}
    assert issubclass(env, SkillEnv)
    scores = {name: SCORES[name] for name in env.score_names}
    return {name: MEANINGS[name] for name in env.skill.measures} | scores


def _weights(env: type[HabEnv]) -> list[str]:
    """Returns a paragraph with the reward weights of a skill."""
    if not issubclass(env, SkillEnv):
        return []
    weights = env.skill.config.weights
    said = (f"`{f.name}` {getattr(weights, f.name):g}" for f in fields(weights))
    return [_paragraph("Weights", f"{', '.join(said)}.")]


def _observed(env: type[HabEnv]) -> str:
    """Returns the observation entries of an environment, with sizes that differ between them."""
    said = [_sized(entry) for entry in env.observation]
    handle = f"; with `handle_position=True` {_sized(env.handle)}" if env.handle else ""
    return f"{', '.join(said)}{handle}; images of {_names(env.cameras)}."


def _sized(entry: ObsEntry) -> str:
    size = f" ({_shape(entry)})" if len(_shapes()[entry.name]) > 1 else ""
    return f"`{entry.name}`{size}"


def _entries() -> list[ObsEntry]:
    """Returns the observation entries of all environments, with their variants."""
    found = [entry for env in ENVS.values() for entry in (*env.env.observation, env.env.handle)]
    named = [entry for entry in found if entry is not None]
    variants = [entry.in_ee for entry in named if entry.in_ee is not None]
    return [*named, *variants]


def _shapes() -> dict[str, list[str]]:
    """Returns entry -> its shapes in all environments."""
    shapes: dict[str, list[str]] = {}
    for entry in _entries():
        known = shapes.setdefault(entry.name, [])
        known.extend({_shape(entry)} - set(known))
    return shapes


def _shape(entry: ObsEntry) -> str:
    return "x".join(map(str, entry.shape))


def _observations() -> str:
    """Returns the table of all observation entries."""
    replaced = {e.in_ee.name: e.name for e in _entries() if e.in_ee is not None}
    rows = []
    for name, shapes in _shapes().items():
        entry = next(e for e in _entries() if e.name == name)
        meaning = entry.meaning
        if name in replaced:
            meaning += f"; replaces `{replaced[name]}`"
        rows.append((f"`{name}`", f"`{entry.group}`", ", ".join(shapes), entry.unit, meaning))
    size = f"{CAMERA_SIZE_PX} x {CAMERA_SIZE_PX}"
    images = f'`depth` (1 = {CAMERA_DEPTH_MAX_M:g} m; int16 mm with `depth="mm"`), `rgb`'
    rows.append(("`head`, `arm`", "`sensor_data`", size, "0 to 1 or 255", images))
    return _table(("entry", "group", "shape", "unit", "meaning"), rows).rstrip()


def _actions() -> tuple[str, str]:
    """Returns the table of all control modes, and its notes."""
    modes = dict.fromkeys(mode for entry in ENVS.values() for mode in entry.env.control_modes)
    configs = control_configs(DEFAULT_ROBOT)
    table = _table(
        ("control mode", "entries", "arm", "base"),
        [
            (f"`{m}`", _sizes(c), ARM_MEANINGS[c.arm], BASE_MEANINGS[c.base])
            for m, c in ((mode, configs[mode]) for mode in modes)
        ],
    )
    linear, angular = DEFAULT_ROBOT.base_linear_speed_m_s, DEFAULT_ROBOT.base_angular_speed_rad_s
    forward, turning = (_numbers(sorted({cell[i] for cell in BASE_CELLS})) for i in (0, 1))
    notes = f"""\
- Gripper: >= 0 grasps, < 0 releases.
- Base velocities: forward and turning (1 = {linear:g} m/s and {angular:g} rad/s). Base pose: x, y
  [m] and yaw [rad] in the world.
- `base_discrete`: all combinations of forward {forward} and turning {turning}.
- Stop action of Navigate: both velocities of `base` within {STOP_SHARE:g} of 0; action {STOP_CELL}
  of `base_discrete`.
"""
    return table, notes


def _sizes(config: HabControllerConfig) -> str:
    """Returns the sizes of a control mode's action entries."""
    if config.base == "discrete":
        return f"0 to {len(BASE_CELLS) - 1}"
    arm = [config.arm_size, 1] if config.arm != "still" else []
    base = [] if config.base == "still" else [BASE_SIZE[config.base]]
    return " + ".join(map(str, [*arm, *base]))


def _measures() -> str:
    """Returns the section of all measures."""
    found = {name: m for entry in ENVS.values() for name, m in measures_of(entry.env).items()}
    rows = [(f"`{name}`", *meaning) for name, meaning in found.items()]
    return f"## Measures\n\n{_table(('name', 'unit', 'meaning'), rows)}".rstrip()


def _parts(env: type[HabEnv]) -> dict[str, str]:
    """Returns the marked parts of a class docstring in Markdown, the first sentence as `Task`."""
    text = textwrap.dedent(f"    {env.__doc__}").replace("``", "`")
    text = text.replace('(terms in `info["reward_terms"]`): ', ": ")
    first, *marked = re.split(r"\*\*(\w+)\*\*", text)
    found = dict(zip(marked[::2], marked[1::2], strict=True))
    # The page generates its own tables.
    found["Observation"] = re.split(r"^ *=====.*$", found["Observation"], flags=re.MULTILINE)[-1]
    found["Action"] = found["Action"].partition("(`hab_tasks.robots.control`). ")[2]
    return {"Task": _flat(first)} | {name: _flat(part) for name, part in found.items()}


def _flat(text: str) -> str:
    return " ".join(text.split()).removeprefix(": ").replace("128²", "128 x 128")


def _paragraph(name: str, text: str) -> str:
    return f"**{name}**{' ' if text.startswith('(') else ': '}{text}".rstrip() + "\n"


def _names(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
