"""The video recorder, an observer of rollouts."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import imageio.v2 as imageio
import numpy as np

from hab_eval.records.video_names import video_name
from hab_eval.run.film import Frame, compose, describe
from hab_tasks.constants import CONTROL_HZ
from hab_tasks.engine.rollout import Job, Outcome, StepInfo
from hab_tasks.files import written_aside

if TYPE_CHECKING:
    import gymnasium as gym

    from hab_tasks.episodes import Episode


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
        """Finishes the file, or removes an unfinished one."""
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
        return compose(views, describe(self._episode_id, self._instruction, seen))
