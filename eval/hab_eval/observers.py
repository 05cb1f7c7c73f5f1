"""Observers of a rollout: the video recorder."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import imageio.v2 as imageio
import numpy as np
from numpy.typing import NDArray

from hab_tasks.constants import CONTROL_HZ

if TYPE_CHECKING:
    import gymnasium as gym

    from hab_tasks.episodes import Episode

Frame = NDArray[np.uint8]


class VideoRecorder:
    """Films the first `count` episodes of a set in real time.

    Frames go straight into the encoder, so that a long episode needs no more memory than a short
    one; the finished file is renamed, so that an interrupted one is never mistaken for it.
    """

    def __init__(self, env: gym.Env[Any, Any], folder: Path, *, count: int) -> None:
        self._env = env
        self._folder = folder
        self._count = count
        self._target: Path | None = None
        self._writer: Any = None

    def start(self, index: int, episode: Episode) -> None:
        """Opens `video_<index>_<episode id>.mp4` and writes its first frame, also as PNG."""
        if index >= self._count:
            return
        safe_id = re.sub(r"[^A-Za-z0-9._-]+", "-", episode.id)
        self._target = self._folder / f"video_{index:03d}_{safe_id}.mp4"
        frame = self._frame()
        imageio.imwrite(self._target.with_suffix(".png"), frame)
        # Two is the smallest multiple of the frame size that players of yuv420p take.
        self._writer = imageio.get_writer(
            self._scratch(self._target),
            format="FFMPEG",  # pyright: ignore[reportArgumentType]  # the stub knows no plugin names
            fps=CONTROL_HZ,
            macro_block_size=2,
        )
        self._writer.append_data(frame)

    def step(self) -> None:
        """Appends one frame."""
        if self._writer is not None:
            self._writer.append_data(self._frame())

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

    def _frame(self) -> Frame:
        """Returns the third-person view (H, W, 3) of the only row."""
        rendered: Any = self._env.render()
        return np.asarray(rendered[0].cpu(), dtype=np.uint8)

    @staticmethod
    def _scratch(target: Path) -> Path:
        return target.with_name(f"partial_{target.name}")
