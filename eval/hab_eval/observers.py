"""Observers of a rollout: the video recorder is one."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import imageio.v2 as imageio
import numpy as np

from hab_eval.film import Frame, compose, describe
from hab_eval.moment import Moment
from hab_tasks.constants import CONTROL_HZ

if TYPE_CHECKING:
    import gymnasium as gym

    from hab_tasks.episodes import Episode


class Observer(Protocol):
    """Sees every episode pass by and changes nothing."""

    def start(self, index: int, episode: Episode, moment: Moment) -> None:
        """Called after the reset of episode number `index` of the set."""
        ...

    def step(self, moment: Moment) -> None:
        """Called after every step."""
        ...

    def end(self) -> None:
        """Called once after the last step."""
        ...

    def abort(self) -> None:
        """Called instead of `end` if the episode did not come to its end."""
        ...


class VideoRecorder:
    """Films the first `count` episodes of a set in real time.

    Frames go straight into the encoder, so that a long episode needs no more memory than a short
    one; the finished file is renamed, so that an interrupted one is never mistaken for it.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        folder: Path,
        *,
        count: int,
        instruct: Callable[[Episode], str] = lambda episode: "",
    ) -> None:
        """Films the first `count` episodes into `folder`; `instruct` tells what is to be done."""
        self._env, self._instruct, self._instruction = env, instruct, ""
        self._folder = folder
        self._count = count
        self._episode_id = ""
        self._target: Path | None = None
        self._writer: Any = None

    def start(self, index: int, episode: Episode, moment: Moment) -> None:
        """Opens `video_<index>_<episode id>.mp4` and writes its first frame, also as PNG."""
        if index >= self._count:
            return
        self._episode_id, self._instruction = episode.id, self._instruct(episode)
        safe_id = re.sub(r"[^A-Za-z0-9._-]+", "-", episode.id)
        self._target = self._folder / f"video_{index:03d}_{safe_id}.mp4"
        frame = self._frame(moment)
        imageio.imwrite(self._target.with_suffix(".png"), frame)
        # Two is the smallest multiple of the frame size that players of yuv420p take.
        self._writer = imageio.get_writer(
            self._scratch(self._target),
            format="FFMPEG",  # pyright: ignore[reportArgumentType]  # the stub knows no plugin names
            fps=CONTROL_HZ,
            macro_block_size=2,
        )
        self._writer.append_data(frame)

    def step(self, moment: Moment) -> None:
        """Appends one frame."""
        if self._writer is not None:
            self._writer.append_data(self._frame(moment))

    def end(self) -> None:
        """Finishes the file."""
        if self._writer is None or self._target is None:
            return
        self._writer.close()
        self._scratch(self._target).replace(self._target)
        self._writer = self._target = None

    def abort(self) -> None:
        """Removes the unfinished file."""
        if self._writer is None or self._target is None:
            return
        self._writer.close()
        self._scratch(self._target).unlink(missing_ok=True)
        self._writer = self._target = None

    def _frame(self, moment: Moment) -> Frame:
        """Returns what the robot's cameras and a person see of the only row, and words below."""
        base: Any = self._env.unwrapped
        rendered: Any = self._env.render()
        pictures = [*base.render_views().values(), rendered]
        views = [np.asarray(picture[0].cpu(), dtype=np.uint8) for picture in pictures]
        return compose(views, describe(self._episode_id, self._instruction, moment))

    @staticmethod
    def _scratch(target: Path) -> Path:
        return target.with_name(f"partial_{target.name}")
