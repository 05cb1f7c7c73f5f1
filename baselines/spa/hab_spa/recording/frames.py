"""What a trajectory does not hold of an episode: images, and the instruction of each stage."""

from __future__ import annotations

import io
import math
import shutil
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import imageio.v2 as imageio
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from hab_spa.recording.dataset_stats import Stats, stats_of
from hab_tasks.constants import CAMERA_DEPTH_MAX_M, CONTROL_HZ
from hab_tasks.engine.rollout import Job, Outcome, StepInfo

if TYPE_CHECKING:
    import gymnasium as gym

Pictures = dict[str, NDArray[Any]]
"""Camera, or camera with ``_depth`` -> image (H, W, 3) uint8, or depth (H, W) uint16 [mm]."""

VIDEO, DEPTH = ".mp4", ".zip"
"""Files of a camera's images: H.264, or a PNG of 16 bits for each step."""

STATS_STEPS, STATS_PX = 5, 4
"""Statistics are of every fifth image, and of every fourth pixel along both axes."""


@dataclass(frozen=True, kw_only=True)
class Seen:
    """An episode as seen and told.

    Attributes:
        task: Its instruction.
        entries: Group, name and size of each entry of the state observation.
        stages: First step and instruction of each stage, in order.
        shapes: Camera -> shape of an image, (H, W, C).
        stats: Camera -> statistics of its images.
    """

    task: str
    entries: tuple[tuple[str, str, int], ...]
    stages: tuple[tuple[int, str], ...]
    shapes: Mapping[str, tuple[int, ...]]
    stats: Mapping[str, Stats]


class FrameRecorder:
    """Observer that writes what is seen before each action to files in `folder`.

    Images are encoded as they come, so that memory does not grow with the episode.
    """

    def __init__(self, env: gym.Env[Any, Any], folder: Path, *, looks: bool) -> None:
        """Takes the environment; `looks` renders images, which its observations do not have."""
        self._env: Any = env.unwrapped
        self._folder, self._looks = folder, looks
        self._files: dict[str, Any] = {}

    def reset(self, job: Job, seen: StepInfo) -> None:
        """Starts an episode; removes the files of the one before."""
        self._close()
        shutil.rmtree(self._folder, ignore_errors=True)
        self._folder.mkdir()
        self._task = self._env.instruction[0]
        self._stages: list[tuple[int, str]] = []
        self._sampled: dict[str, list[NDArray[Any]]] = {}
        self._shapes: dict[str, tuple[int, ...]] = {}
        self._before = self._look(seen)

    def step(self, seen: StepInfo) -> None:
        """Writes what was seen before the action."""
        pictures, stage = self._before
        number = seen.step - 1
        if not self._stages or self._stages[-1][1] != stage:
            self._stages.append((number, stage))
        for name, picture in pictures.items():
            self._write(name, picture, number)
        self._before = self._look(seen)

    def end(self, outcome: Outcome | None) -> None:
        """Completes the files."""
        self._close()

    def seen(self) -> Seen:
        """Returns what was seen in the finished episode, without the images."""
        return Seen(
            task=self._task,
            entries=tuple((e.group, e.name, math.prod(e.shape)) for e in self._env.entries),
            stages=tuple(self._stages),
            shapes=self._shapes,
            stats={name: stats_of(np.stack(images)) for name, images in self._sampled.items()},
        )

    def images(self) -> dict[str, bytes]:
        """Returns the files of the finished episode, by name."""
        return {file.name: file.read_bytes() for file in sorted(self._folder.iterdir())}

    def _look(self, seen: StepInfo) -> tuple[Pictures, str]:
        observed = seen.obs if isinstance(seen.obs, Mapping) else {}
        data = self._env.look() if self._looks else observed
        pictures: Pictures = {}
        for camera, images in data.get("sensor_data", {}).items():
            if "rgb" in images:
                pictures[camera] = images["rgb"][0].cpu().numpy()
            if "depth" in images:
                depth_mm = images["depth"][0, ..., 0].cpu().numpy() * (CAMERA_DEPTH_MAX_M * 1000)
                pictures[f"{camera}_depth"] = np.rint(depth_mm).astype(np.uint16)
        return pictures, self._env.stage_instruction[0]

    def _write(self, name: str, picture: NDArray[Any], number: int) -> None:
        is_depth = picture.ndim == 2
        if name not in self._files:
            self._files[name] = self._depth_file(name) if is_depth else self._video(name, picture)
            self._shapes[name] = (*picture.shape[:2], 1 if is_depth else 3)
        if is_depth:
            self._files[name].writestr(f"{number:06d}.png", png(picture))
        else:
            self._files[name].append_data(picture)
        if number % STATS_STEPS == 0:
            small = picture[::STATS_PX, ::STATS_PX]
            self._sampled.setdefault(name, []).append(small.reshape(*small.shape[:2], -1))

    def _depth_file(self, name: str) -> zipfile.ZipFile:
        return zipfile.ZipFile(self._folder / f"{name}{DEPTH}", "w")  # PNG is compressed already

    def _video(self, name: str, picture: NDArray[Any]) -> Any:
        # Every second frame can be decoded alone, as LeRobot writes them: training reads at random.
        # One thread: the file does not depend on the machine's cores.
        options = ["-g", "2", "-bf", "0", "-crf", "23", "-preset", "veryfast", "-threads", "1"]
        even = not any(size % 2 for size in picture.shape[:2])
        return imageio.get_writer(
            self._folder / f"{name}{VIDEO}",
            format="FFMPEG",  # pyright: ignore[reportArgumentType]  # the stub knows no plugin names
            fps=CONTROL_HZ,
            codec="libx264",
            quality=None,
            pixelformat="yuv420p" if even else "yuv444p",
            macro_block_size=1,
            output_params=options,
        )

    def _close(self) -> None:
        for file in self._files.values():
            file.close()
        self._files = {}


def png(picture: NDArray[Any]) -> bytes:
    """Returns an image as a PNG file."""
    file = io.BytesIO()
    Image.fromarray(picture).save(file, format="PNG", compress_level=1)
    return file.getvalue()
