"""Video frames: camera images side by side, with the episode's state as text below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from PIL import Image

from hab_tasks.captions import Frame, with_words
from hab_tasks.constants import CONTROL_HZ
from hab_tasks.engine.rollout import StepInfo

LINES = 7
"""Number of caption lines."""


def compose(views: Sequence[Frame], lines: Sequence[str]) -> Frame:
    """Returns one frame (H, W, 3) with the `views` side by side, scaled to the tallest.

    Args:
        views: Images (h, w, 3) uint8.
        lines: Caption; long lines are wrapped, and lines beyond `LINES` are dropped.
    """
    height = max(view.shape[0] for view in views)
    row = np.concatenate([_scaled(view, height) for view in views], axis=1)
    return with_words(row, lines, LINES)


def describe(episode_id: str, instruction: str, step_info: StepInfo) -> list[str]:
    """Returns the caption: task, outcome, plan step, stages, reward terms and return."""
    info = step_info.info
    time_s = step_info.step / CONTROL_HZ
    lines = [f"{episode_id}   step {step_info.step}   {time_s:.1f} s   {_outcome(info)}".rstrip()]
    lines += [instruction] if instruction else []
    lines += [step_info.doing] if step_info.doing else []
    lines += _stages(info)
    if step_info.step:  # there is no reward at a reset
        terms = {name: float(value) for name, value in info.get("reward_terms", {}).items()}
        nonzero = ", ".join(f"{name} {value:+.4f}" for name, value in terms.items() if value)
        lines.append(f"reward {step_info.reward:+.4f}" + (f" = {nonzero}" if nonzero else ""))
    return [*lines, f"return {step_info.episode_return:+.3f}"]


def _outcome(info: Mapping[str, Any]) -> str:
    """Returns success and failures by name; empty while the episode is running."""
    ends = {"success": info.get("success", False), **info.get("failures", {})}
    return " ".join(name for name, value in ends.items() if bool(value))


def _stages(info: Mapping[str, Any]) -> list[str]:
    """Returns a task's current part and its reached stages; empty for a skill."""
    stages = info.get("stages", {})
    if not stages:
        return []
    reached = [name for name, value in stages.items() if bool(value)]
    part = f"part {int(info['part']['number'])}   " if "part" in info else ""
    return [f"{part}{len(reached)} of {len(stages)} stages: {' '.join(reached)}".rstrip(" :")]


def _scaled(view: Frame, height: int) -> Frame:
    """Scales an image (h, w, 3) to a height, keeping its aspect ratio."""
    if view.shape[0] == height:
        return view
    width = round(view.shape[1] * height / view.shape[0])
    return np.asarray(Image.fromarray(view).resize((width, height), Image.Resampling.BICUBIC))
