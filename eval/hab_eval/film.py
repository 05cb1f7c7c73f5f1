"""One frame of a film: pictures side by side, and below them what is going on, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from PIL import Image

from hab_eval.moment import Moment
from hab_tasks.captions import Frame, with_words
from hab_tasks.constants import CONTROL_HZ

LINES = 7
"""Room for words."""


def compose(views: Sequence[Frame], lines: Sequence[str]) -> Frame:
    """Returns one frame (H, W, 3) with the `views` in a row, as high as the highest of them.

    Args:
        views: Pictures (h, w, 3) uint8.
        lines: Words below them; long lines are broken, and what finds no room is left out.
    """
    height = max(view.shape[0] for view in views)
    row = np.concatenate([_enlarged(view, height) for view in views], axis=1)
    return with_words(row, lines, LINES)


def describe(episode_id: str, instruction: str, moment: Moment) -> list[str]:
    """Returns the words on one moment: task, outcome, plan step, stages, reward terms, return."""
    info = moment.info
    time_s = moment.step / CONTROL_HZ
    words = [f"{episode_id}   step {moment.step}   {time_s:.1f} s   {_outcome(info)}".rstrip()]
    words += [instruction] if instruction else []
    words += [moment.doing] if moment.doing else []
    words += _stages(info)
    if moment.step:  # a reset pays nothing
        terms = {name: float(value) for name, value in info.get("reward_terms", {}).items()}
        paid = ", ".join(f"{name} {value:+.4f}" for name, value in terms.items() if value)
        words.append(f"reward {moment.reward:+.4f}" + (f" = {paid}" if paid else ""))
    return [*words, f"return {moment.episode_return:+.3f}"]


def _outcome(info: Mapping[str, Any]) -> str:
    """Names what ended the episode, nothing while it goes on."""
    ends = {"success": info.get("success", False), **info.get("failures", {})}
    return " ".join(name for name, value in ends.items() if bool(value))


def _stages(info: Mapping[str, Any]) -> list[str]:
    """Returns a task's present part and the stages that were reached; nothing for a skill."""
    stages = info.get("stages", {})
    if not stages:
        return []
    reached = [name for name, value in stages.items() if bool(value)]
    part = f"part {int(info['part']['number'])}   " if "part" in info else ""
    return [f"{part}{len(reached)} of {len(stages)} stages: {' '.join(reached)}".rstrip(" :")]


def _enlarged(view: Frame, height: int) -> Frame:
    """Returns a picture (h, w, 3) at another height, as wide as it then has to be."""
    if view.shape[0] == height:
        return view
    width = round(view.shape[1] * height / view.shape[0])
    return np.asarray(Image.fromarray(view).resize((width, height), Image.Resampling.BICUBIC))
