"""Motions: the pose of every visible body in every step of an episode, and what belongs to it.

A motion holds no meshes, only the names of their files, and is read on the machine that made it.
"""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hab_eval.run.film import outcome_words, stage_lines
from hab_tasks.arrays import Floats
from hab_tasks.captions import Frame
from hab_tasks.constants import CAMERA_DEPTH_MAX_M, CAMERA_HFOV_RAD
from hab_tasks.engine.rollout import Job, Outcome, StepInfo
from hab_tasks.io.files import written_aside

if TYPE_CHECKING:
    import gymnasium as gym

    from hab_tasks.engine.ray_sensors import RaySensors
    from hab_tasks.world.raycast.scene import RayBody
    from hab_tasks.world.scenes.visuals import Visuals

FILE = "motion.pickle"

IMAGE_STEPS = 6
"""Steps between two images of the cameras: 5 Hz."""

DEPTH_SIZE_PX = 128
VIEWS = ("head", "arm")

Color = tuple[float, float, float]


@dataclass(kw_only=True)
class Motion:
    """Motion of an episode of T steps; T + 1 entries with the start.

    Attributes:
        episode: Id of the episode.
        instruction: The task in words.
        bodies: Name and shapes of each of B bodies.
        poses: Position [m] and quaternion (w, x, y, z) in the world, each (B, 7).
        bases: x [m], y [m] and yaw [rad] of the robot's base, each (3,).
        marks: Colors of the M marks on targets, goals and handles.
        marks_m: Tips of their arrows, each (M, 3).
        contacts_m: Points where the robot touches other bodies, each (C, 3).
        captions: Outcome, stages and current activity.
        images: Step -> camera -> image (H, W, 3) uint8, every `IMAGE_STEPS`.
    """

    episode: str
    instruction: str
    bodies: list[tuple[str, Visuals]]
    marks: list[Color]
    poses: list[Floats] = field(default_factory=list)
    bases: list[Floats] = field(default_factory=list)
    marks_m: list[Floats] = field(default_factory=list)
    contacts_m: list[Floats] = field(default_factory=list)
    captions: list[str] = field(default_factory=list)
    images: dict[int, dict[str, Frame]] = field(default_factory=dict)


class MotionRecorder:
    """Records the motion of an episode, and writes it to `FILE` in a folder at the end."""

    def __init__(self, env: gym.Env[Any, Any], folder: Path) -> None:
        """Records the episodes of an environment; needs no renderer."""
        self._env: Any = env.unwrapped
        self._folder = folder
        self._motion: Motion | None = None
        self._bodies: list[RayBody] = []
        self._rays: RaySensors | None = None

    def reset(self, job: Job, seen: StepInfo) -> None:
        """Starts a motion with the bodies of the new scene."""
        from hab_tasks.engine.ray_sensors import visible_bodies
        from hab_tasks.engine.viewpoint import marked_points  # loads the simulator

        env = self._env
        self._rays = None
        self._bodies = [one for one in visible_bodies(env.simulation, env.agent) if one.visuals]
        self._motion = Motion(
            episode=job.episode.id,
            instruction=env.instruction[0],
            bodies=[(body.name, body.visuals) for body in self._bodies],
            marks=[color for color, _ in marked_points(env.simulation)],
        )
        self._add(self._motion, seen)

    def step(self, seen: StepInfo) -> None:
        """Adds a step."""
        if self._motion is not None:
            self._add(self._motion, seen)

    def end(self, outcome: Outcome | None) -> None:
        """Writes a finished episode."""
        if outcome is not None:
            with written_aside(self._folder / FILE) as scratch, scratch.open("wb") as file:
                pickle.dump(self._motion, file)
        self._motion = None

    def _add(self, motion: Motion, seen: StepInfo) -> None:
        from hab_tasks.engine.viewpoint import tips_m

        simulation = self._env.simulation
        poses = [body.entity.pose for body in self._bodies]
        motion.poses.append(np.array([(*pose.p, *pose.q) for pose in poses], dtype=np.float32))
        motion.bases.append(np.array(simulation.snapshot.base[0]))
        motion.marks_m.append(tips_m(simulation))
        motion.contacts_m.append(simulation.contact_points_m())
        words = [outcome_words(seen.info), seen.doing, *stage_lines(seen.info)]
        motion.captions.append("\n".join(filter(None, words)))
        if seen.step % IMAGE_STEPS == 0:
            motion.images[seen.step] = self._images(seen)

    def _images(self, seen: StepInfo) -> dict[str, Frame]:
        """Returns the observed color images, else depth images of the head and the arm."""
        data = seen.obs.get("sensor_data", {}) if isinstance(seen.obs, Mapping) else {}
        colors = {name: one["rgb"][0].cpu().numpy() for name, one in data.items() if "rgb" in one}
        return colors or {name: gray(depth) for name, depth in self._depths().items()}

    def _depths(self) -> dict[str, Floats]:
        """Returns depth images (H, W) [m], 0 without a return."""
        from mani_skill.envs.utils.observations import CameraObsTextures

        from hab_tasks.engine.ray_sensors import RaySensors
        from hab_tasks.robots.cameras import CameraRig

        env = self._env
        if self._rays is None:
            names = [name for name in VIEWS if name in env.robot.cameras]
            rig = CameraRig.of(env.robot, names, DEPTH_SIZE_PX, CAMERA_HFOV_RAD)
            cameras = rig.configs(env.agent.link)
            self._rays = RaySensors(env.simulation, env.agent, cameras, {}, hides_arm=False)
        wanted = CameraObsTextures(
            rgb=False,
            depth=True,
            segmentation=False,
            position=False,
            normal=False,
            albedo=False,
        )
        images = self._rays.images(wanted)
        return {name: one["depth"][0, :, :, 0].numpy() / 1000.0 for name, one in images.items()}


def gray(depth_m: Floats) -> Frame:
    """Returns a depth image as a picture (H, W, 3): near is bright, no return is black."""
    near = 1.0 - np.sqrt(np.clip(depth_m / CAMERA_DEPTH_MAX_M, 0.0, 1.0))
    shade = np.where(depth_m > 0, 255 * near, 0).astype(np.uint8)
    return np.repeat(shade[:, :, None], 3, axis=2)


def read_motion(folder: Path) -> Motion:
    """Returns the motion that a recorder wrote to a folder of this process."""
    with (folder / FILE).open("rb") as file:
        return pickle.load(file)
