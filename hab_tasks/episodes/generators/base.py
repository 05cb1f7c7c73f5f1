"""Base of the episode generators: attempts, rejection reasons, clutter and seeding.

Each episode uses only its own random generator, seeded by (dataset, split, env), seed and index.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from transforms3d import quaternions

from hab_tasks.episodes.held import Held, in_fingers
from hab_tasks.episodes.layout_memory import LayoutMemory
from hab_tasks.episodes.placing import Placer, Settling
from hab_tasks.episodes.robot_start import (
    NOTHING_NEAR,
    KeepOff,
    RobotStarts,
    StartNoise,
    ee_in_world,
)
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import (
    Episode,
    HandleRef,
    Rearrangement,
    RobotStart,
    rounded,
)
from hab_tasks.episodes.spots import Spot, find_spots
from hab_tasks.errors import GenerationError, RejectedSampleError
from hab_tasks.geometry import (
    Pose7,
    from_matrix,
    planar,
    pose,
    rotation_between,
    to_matrix,
)
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.world.scenes.spec import ObjectTemplate, SceneSpec

ATTEMPTS = 200
LAYOUTS = 20
"""Maximum number of layouts tried per episode."""


@dataclass(frozen=True, kw_only=True)
class Made:
    """A generated episode, with its rejections by reason."""

    episode: Episode
    rejections: Counter[str]


@dataclass(frozen=True, kw_only=True)
class Objects:
    """Objects that a generator samples from, and other differences between protocols.

    Attributes:
        templates: Name -> template of all loaded objects.
        names: Names to sample clutter and targets from.
        robot: The robot that starts there.
        receptacles: Receptacles of Pick, Place and Navigate; None for the skill's own.
    """

    templates: dict[str, ObjectTemplate]
    names: tuple[str, ...]
    robot: RobotSpec
    receptacles: tuple[str, ...] | None = None


class Generator(ABC):
    """Generates the episodes of one env in the given layouts.

    Attributes:
        version: Incremented when the same seed gives other episodes; cached files of other
            versions are ignored.
        refused: Reason -> number of rejected candidates of the current episode.
    """

    version: ClassVar[int] = 9
    settling: ClassVar[Settling] = Settling()
    noise: ClassVar[StartNoise] = StartNoise()

    def __init__(
        self, scenes: Sequence[str], load: Callable[[str], SceneSpec], objects: Objects
    ) -> None:
        """Samples layouts from `scenes`; `load` reads one."""
        self.scenes, self.load, self.objects = scenes, load, objects
        self.kinematics = ArmKinematics(objects.robot)
        self.refused: Counter[str] = Counter()
        self.memory = LayoutMemory()
        self._sandbox: PlacementSandbox | None = None
        self._spots: dict[tuple[str, ...], list[Spot]] = {}

    @abstractmethod
    def attempt(self, sandbox: PlacementSandbox, rng: np.random.Generator) -> Episode:
        """Returns one candidate, with empty id, layout and seed.

        Raises:
            RejectedSampleError: The candidate is invalid.
        """

    def attempt_for(
        self, other: Generator, sandbox: PlacementSandbox, rng: np.random.Generator
    ) -> Episode:
        """Returns one candidate as part of an attempt of another generator."""
        self.refused, self._spots = other.refused, {}
        return self.attempt(sandbox, rng)

    def generate(self, episode_id: str, seed: tuple[int, ...], first: str | None = None) -> Made:
        """Generates one episode; the seed is the only source of randomness.

        `first` is the layout to try first; None samples it as well.

        Raises:
            GenerationError: Every attempt was rejected; the message has the counts by reason.
        """
        rng = np.random.default_rng(seed)
        refused = self.refused = Counter()
        layouts = min(LAYOUTS, len(self.scenes))
        for number in range(layouts):
            scene_id = self.scenes[int(rng.integers(len(self.scenes)))]
            if number == 0 and first is not None:
                scene_id = first
            # A fresh simulation, as contact caches of an earlier episode affect the result.
            sandbox = self.new_sandbox(self.load(scene_id))
            self._spots = {}
            for _ in range(ATTEMPTS // layouts):
                try:
                    episode = self.attempt(sandbox, rng)
                    refuse_unrest(sandbox, episode)
                except RejectedSampleError as reason:
                    refused[str(reason)] += 1
                    continue
                made = replace(
                    episode, id=episode_id, seed=int(rng.integers(2**31)), loose=sandbox.settled
                )
                return Made(episode=made, rejections=refused)
        raise GenerationError(f"{episode_id}: no start state found; rejected: {dict(refused)}.")

    def new_sandbox(self, spec: SceneSpec) -> PlacementSandbox:
        """Returns a sandbox with a new simulation; bodies of the previous one are used again."""
        # One that was interrupted while it began again is not used any more.
        sandbox, self._sandbox = self._sandbox, None
        if sandbox is None:
            sandbox = PlacementSandbox(
                spec, self.objects.templates, self.memory, self.objects.robot
            )
        else:
            sandbox.begin_again(spec)
        self._sandbox = sandbox
        return sandbox

    # Parts of an attempt ---------------------------------------------------------------------

    def starts(
        self, sandbox: PlacementSandbox, rng: np.random.Generator, keep_off: KeepOff = NOTHING_NEAR
    ) -> RobotStarts:
        """Returns the sampler of robot starts, with the hand clear of `keep_off`."""
        starts = RobotStarts(sandbox, rng, self.kinematics, self.noise, keep_off)
        starts.refused = self.refused
        return starts

    def spots(self, sandbox: PlacementSandbox, names: tuple[str, ...]) -> list[Spot]:
        """Returns the usable receptacles of these names, with the joints that open them.

        Raises:
            RejectedSampleError: The layout has none of them.
        """
        if names not in self._spots:
            sandbox.show(())
            self._spots[names] = find_spots(sandbox, names)
        if not self._spots[names]:
            raise RejectedSampleError("no usable receptacle in the layout")
        return self._spots[names]

    def draw_spot(
        self, sandbox: PlacementSandbox, rng: np.random.Generator, names: tuple[str, ...]
    ) -> Spot:
        """Samples one of the usable receptacles of these names.

        Raises:
            RejectedSampleError: The layout has none of them.
        """
        spots = self.spots(sandbox, names)
        return spots[int(rng.integers(len(spots)))]

    def in_hand(self, held: Held, robot: RobotStart, yaw_rad: float) -> Pose7:
        """Returns the start pose of a held object.

        The snap grasp holds it upright with its centre of mass at the end-effector, fingers hold
        it between them.
        """
        if (fingers := self.objects.robot.fingers) is not None:
            hand_from_object = in_fingers(held, fingers)
            base_from_hand = self.kinematics.pose(robot.arm_pose(self.objects.robot))
            base_from_hand[2, 3] += self.objects.robot.base_height_m
            world_from_base = to_matrix(planar(*robot.base))
            return rounded(from_matrix(world_from_base @ base_from_hand @ hand_from_object))
        turn = quaternions.axangle2quat([0.0, 0.0, 1.0], yaw_rad)
        q = quaternions.qmult(turn, rotation_between(held.up, np.array([0.0, 0.0, 1.0])))
        ee_m = ee_in_world(self.kinematics, robot.base, robot.arm_pose(self.objects.robot))
        return rounded(pose(ee_m - quaternions.rotate_vector(held.com_m, q), q))

    def draw(self, rng: np.random.Generator, count: int) -> list[str]:
        """Samples objects with replacement; returns the names of their instances."""
        names = [self.objects.names[i] for i in rng.integers(len(self.objects.names), size=count)]
        return instances(names)

    def settled(
        self, sandbox: PlacementSandbox, rng: np.random.Generator, handles: list[str], spot: Spot
    ) -> dict[str, Pose7]:
        """Puts objects in an open receptacle; returns the poses of those that rest in it.

        Raises:
            RejectedSampleError: None does.
        """
        sandbox.show(handles)
        sandbox.open_joints(spot.joints)
        placer = Placer(sandbox, rng, self.settling)
        put_all(placer, handles, [spot])
        objects = placer.settle()
        if not objects:
            raise RejectedSampleError("nothing rests on the receptacle")
        return objects


def instances(names: Iterable[str]) -> list[str]:
    """Returns instance names for objects that may repeat: ``bowl_:0000``, ``bowl_:0001``."""
    seen: Counter[str] = Counter()
    found = []
    for name in names:
        found.append(f"{name}_:{seen[name]:04d}")
        seen[name] += 1
    return found


def put_all(placer: Placer, names: Iterable[str], spots: Sequence[Spot]) -> list[str]:
    """Places each object on a random spot; returns the objects that were placed."""
    return [name for name in names if placer.put(name, spots)]


def pose_scene(
    sandbox: PlacementSandbox, objects: dict[str, Pose7], joints: dict[str, dict[str, float]]
) -> None:
    """Sets objects to their settled poses, and furniture to these joint positions."""
    sandbox.show(objects)
    sandbox.open_joints(joints)
    for name, at in objects.items():
        sandbox.place(name, at)


def refuse_unrest(sandbox: PlacementSandbox, episode: Episode) -> None:
    """Rejects a start state in which an object moves by itself; ends the simulation of others.

    Raises:
        RejectedSampleError: An object of the episode or of the layout moves.
    """
    resting = {name: pose for name, pose in episode.objects.items() if name != episode.held}
    pose_scene(sandbox, resting, episode.joints)
    if sandbox.restless(resting, ends=True):
        raise RejectedSampleError("an object moves by itself")


def start_state(
    sandbox: PlacementSandbox,
    robot: RobotStart,
    objects: dict[str, Pose7],
    targets: tuple[Rearrangement, ...],
    held: str | None = None,
    handle: HandleRef | None = None,
) -> Episode:
    """Returns an episode with the current furniture; `generate` fills in the empty fields."""
    return Episode(
        id="",
        scene_id=sandbox.spec.scene_id,
        seed=0,
        robot=robot,
        objects=objects,
        targets=targets,
        held=held,
        handle=handle,
        joints=sandbox.joints(),
    )
