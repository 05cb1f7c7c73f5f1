"""What all generators share: attempts, reasons of refusal, clutter, and one seeded generator.

Each episode draws only from its own generator, seeded by (dataset, split, env), seed and index.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from hab_tasks.episodes.placing import Placer, Settling
from hab_tasks.episodes.receptacles import Spot, find_spots
from hab_tasks.episodes.refusal import RefusedError
from hab_tasks.episodes.robot_start import NOTHING_NEAR, KeepOff, RobotStarts, StartNoise
from hab_tasks.episodes.schema import Episode, HandleRef, Rearrangement, RobotStart
from hab_tasks.episodes.workbench import Workbench
from hab_tasks.errors import GenerationError
from hab_tasks.geometry import Pose7
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.scenes.spec import ObjectTemplate, SceneSpec

ATTEMPTS = 200
LAYOUTS = 20
"""An episode whose layout offers no start state moves to another one, so many times."""


@dataclass(frozen=True, kw_only=True)
class Made:
    """A generated episode, and why candidates were refused."""

    episode: Episode
    rejections: Counter[str]


@dataclass(frozen=True, kw_only=True)
class Objects:
    """Which objects a generator draws from, and what else varies between protocols.

    Attributes:
        templates: Name -> template of everything that is loaded.
        names: The names that are drawn as clutter and targets.
        receptacles: The receptacles of Pick, Place and Navigate; None for the skill's own.
    """

    templates: dict[str, ObjectTemplate]
    names: tuple[str, ...]
    receptacles: tuple[str, ...] | None = None


class Generator(ABC):
    """Makes the episodes of one env in the given layouts.

    Attributes:
        version: Goes up when the same seed gives other episodes; cached files of another version
            are not used.
        refused: Reason -> how many candidates of the present episode were refused.
    """

    version: ClassVar[int] = 8
    settling: ClassVar[Settling] = Settling()
    noise: ClassVar[StartNoise] = StartNoise()

    def __init__(
        self, scenes: Sequence[str], load: Callable[[str], SceneSpec], objects: Objects
    ) -> None:
        """Draws layouts from `scenes`; `load` reads one."""
        self.scenes, self.load, self.objects = scenes, load, objects
        self.kinematics = ArmKinematics()
        self.refused: Counter[str] = Counter()
        self._spots: dict[tuple[str, ...], list[Spot]] = {}

    @abstractmethod
    def attempt(self, bench: Workbench, rng: np.random.Generator) -> Episode:
        """Returns one candidate, its id, layout and seed still empty.

        Raises:
            RefusedError: The candidate does not hold.
        """

    def generate(self, episode_id: str, seed: tuple[int, ...], first: str | None = None) -> Made:
        """Makes one episode.

        Args:
            episode_id: Its id.
            seed: It depends on nothing else.
            first: The layout that is tried before others; None to draw that one as well.

        Raises:
            GenerationError: Every attempt was refused; the message counts the reasons.
        """
        rng = np.random.default_rng(seed)
        refused = self.refused = Counter()
        layouts = min(LAYOUTS, len(self.scenes))
        for number in range(layouts):
            scene_id = self.scenes[int(rng.integers(len(self.scenes)))]
            if number == 0 and first is not None:
                scene_id = first
            # A fresh simulation: contact caches of an earlier episode would leave traces.
            bench = Workbench(self.load(scene_id), self.objects.templates)
            self._spots = {}
            for _ in range(ATTEMPTS // layouts):
                try:
                    episode = self.attempt(bench, rng)
                    refuse_unrest(bench, episode)
                except RefusedError as reason:
                    refused[str(reason)] += 1
                    continue
                made = replace(
                    episode,
                    id=episode_id,
                    seed=int(rng.integers(2**31)),
                    loose=bench.settled,
                )
                return Made(episode=made, rejections=refused)
        raise GenerationError(f"{episode_id}: no start state found; refused: {dict(refused)}.")

    # Parts of an attempt ---------------------------------------------------------------------

    def starts(
        self, bench: Workbench, rng: np.random.Generator, keep_off: KeepOff = NOTHING_NEAR
    ) -> RobotStarts:
        """Returns the finder of robot starts, whose hand starts off `keep_off`."""
        starts = RobotStarts(bench, rng, self.kinematics, self.noise, keep_off)
        starts.refused = self.refused
        return starts

    def spots(self, bench: Workbench, names: tuple[str, ...]) -> list[Spot]:
        """Returns the usable receptacles of these names, with the joints that open them.

        Raises:
            RefusedError: The layout has none of them.
        """
        if names not in self._spots:
            bench.show(())
            self._spots[names] = find_spots(bench, names)
        if not self._spots[names]:
            raise RefusedError("no usable receptacle in the layout")
        return self._spots[names]

    def draw(self, rng: np.random.Generator, count: int) -> list[str]:
        """Draws objects with repetition; returns the handles of their instances."""
        names = [self.objects.names[i] for i in rng.integers(len(self.objects.names), size=count)]
        return instances(names)


def instances(names: Iterable[str]) -> list[str]:
    """Returns handles for object names that may repeat: ``bowl_:0000``, ``bowl_:0001``."""
    seen: Counter[str] = Counter()
    handles = []
    for name in names:
        handles.append(f"{name}_:{seen[name]:04d}")
        seen[name] += 1
    return handles


def put_all(placer: Placer, handles: Iterable[str], spots: Sequence[Spot]) -> list[str]:
    """Stands objects on the spots, each on a random one; returns those that found room."""
    return [handle for handle in handles if placer.put(handle, spots)]


def stage(bench: Workbench, objects: dict[str, Pose7], joints: dict[str, dict[str, float]]) -> None:
    """Shows objects where they settled, and the furniture with these joints."""
    bench.show(objects)
    open_joints(bench, joints)
    for handle, pose in objects.items():
        bench.place(handle, pose)


def refuse_unrest(bench: Workbench, episode: Episode) -> None:
    """Refuses a start in which something does not stay where it is, by itself.

    Raises:
        RefusedError: An object moves, or one of the layout's own.
    """
    resting = {handle: pose for handle, pose in episode.objects.items() if handle != episode.held}
    stage(bench, resting, episode.joints)
    if bench.restless(resting):
        raise RefusedError("an object moves by itself")


def open_joints(bench: Workbench, joints: dict[str, dict[str, float]]) -> None:
    """Moves furniture joints; the others stay as they are."""
    for furniture, positions in joints.items():
        for joint, value in positions.items():
            bench.set_joint(furniture, joint, value)


def start_state(
    bench: Workbench,
    robot: RobotStart,
    objects: dict[str, Pose7],
    targets: tuple[Rearrangement, ...],
    held: str | None = None,
    handle: HandleRef | None = None,
) -> Episode:
    """Returns an episode with the furniture as it stands; `generate` fills in what is empty."""
    return Episode(
        id="",
        scene_id=bench.spec.scene_id,
        seed=0,
        robot=robot,
        objects=objects,
        targets=targets,
        held=held,
        handle=handle,
        joints=bench.joints(),
    )
