"""Videos: camera images side by side, with the episode's state as text below."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import imageio.v2 as imageio
import numpy as np
from PIL import Image

from hab_eval.records.results import video_name
from hab_tasks.captions import Frame, with_words
from hab_tasks.constants import CONTROL_HZ
from hab_tasks.engine.rollout import Job, Outcome, StepInfo
from hab_tasks.io.files import written_aside

if TYPE_CHECKING:
    import gymnasium as gym

    from hab_tasks.episodes import Episode

LINES = 8
"""Number of caption lines."""

HELD_S = 1.0
"""Time for which the last frame is shown, with the outcome."""


class _AbortedError(Exception):
    """Discards a temporary file."""


class VideoRecorder:
    """Records videos of the first `count` episodes of a set, at real-time speed.

    Frames are encoded as they come, so that memory does not grow with the episode, and written to a
    temporary file, so that an interrupted video is never mistaken for a complete one.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        folder: Path,
        *,
        count: int,
        instruct: Callable[[Episode], str] = lambda episode: "",
    ) -> None:
        """Records the first `count` episodes into `folder`; `instruct` returns instructions."""
        self._env, self._instruct, self._instruction = env, instruct, ""
        self._folder = folder
        self._count = count
        self._episode_id = ""
        self._file = ExitStack()
        self._writer: Any = None
        self._last: tuple[list[Frame], list[str], str] = ([], [], "")

    def reset(self, job: Job, seen: StepInfo) -> None:
        """Opens `video_<index>_<episode id>.mp4` and writes its first frame, also as PNG."""
        index, episode, _ = job
        if index >= self._count:
            return
        self._episode_id, self._instruction = episode.id, self._instruct(episode)
        target = self._folder / f"{video_name(index, episode.id)}.mp4"
        frame = self._frame(seen)
        with written_aside(target.with_suffix(".png")) as scratch:
            imageio.imwrite(scratch, frame)
        # yuv420p needs frame sizes that are multiples of two.
        self._writer = imageio.get_writer(
            self._file.enter_context(written_aside(target)),
            format="FFMPEG",  # pyright: ignore[reportArgumentType]  # the stub knows no plugin names
            fps=CONTROL_HZ,
            macro_block_size=2,
        )
        self._file.callback(self._writer.close)
        self._writer.append_data(frame)

    def step(self, seen: StepInfo) -> None:
        """Appends one frame."""
        if self._writer is not None:
            self._writer.append_data(self._frame(seen))

    def end(self, outcome: Outcome | None) -> None:
        """Holds the last frame and finishes the file, or removes an unfinished one."""
        if outcome is not None and self._writer is not None:
            views, lines, hand = self._last
            ending = "success" if outcome.success else outcome.failure or "timeout"
            frame = compose(views, [f"{ending}: {hand}", *lines])
            for _ in range(round(HELD_S * CONTROL_HZ)):
                self._writer.append_data(frame)
        self._writer = None
        with suppress(_AbortedError), self._file:
            if outcome is None:
                raise _AbortedError

    def _frame(self, seen: StepInfo) -> Frame:
        """Returns a frame with the robot's cameras, the render camera and a caption."""
        base: Any = self._env.unwrapped
        rendered: Any = self._env.render()
        pictures = [*base.render_views().values(), rendered]
        views = [np.asarray(picture[0].cpu(), dtype=np.uint8) for picture in pictures]
        lines = describe(self._episode_id, self._instruction, seen)
        self._last = views, lines, base.hand_and_force()
        return compose(views, lines)


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
    lines = [
        f"{episode_id}   step {step_info.step}   {time_s:.1f} s   {outcome_words(info)}".rstrip()
    ]
    lines += [instruction] if instruction else []
    lines += [step_info.doing] if step_info.doing else []
    lines += stage_lines(info)
    if step_info.step:  # there is no reward at a reset
        terms = {name: float(value) for name, value in info.get("reward_terms", {}).items()}
        nonzero = ", ".join(f"{name} {value:+.4f}" for name, value in terms.items() if value)
        lines.append(f"reward {step_info.reward:+.4f}" + (f" = {nonzero}" if nonzero else ""))
    return [*lines, f"return {step_info.episode_return:+.3f}"]


def outcome_words(info: Mapping[str, Any]) -> str:
    """Returns success and failures by name; empty while the episode is running."""
    ends = {"success": info.get("success", False), **info.get("failures", {})}
    return " ".join(name for name, value in ends.items() if bool(value))


def stage_lines(info: Mapping[str, Any]) -> list[str]:
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
