"""Start states of tasks (S G.1): clutter, targets and goals.

Goals are sampled like starts: a second instance of each target is placed at the goal, settles with
everything else, and is removed. Containers that start closed are filled while open.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from hab_tasks.articulations import ARTICULATION_KINDS
from hab_tasks.episodes.generators.base import (
    Generator,
    Objects,
    instances,
    pose_scene,
    put_all,
    start_state,
)
from hab_tasks.episodes.generators.furniture import carried, find_articulation, handles_m, slides
from hab_tasks.episodes.placing import AWAY, Placer
from hab_tasks.episodes.robot_start import KeepOff
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import Episode, Rearrangement
from hab_tasks.episodes.spots import Spot, widest
from hab_tasks.errors import RejectedSampleError
from hab_tasks.geometry import Pose7
from hab_tasks.receptacles import CONTAINERS, DRAWER
from hab_tasks.task_spec import ARTICULATIONS, TaskSpec
from hab_tasks.world.scenes.spec import SceneSpec

LEAST_MOVE_M = 0.5
"""Minimum distance between a start and its goal (Habitat's generator)."""

KEPT_CLUTTER = 0.8
"""Minimum share of stable clutter; unstable clutter is removed, as in Habitat's generator."""

KEEP_OFF_M = 0.6
"""Minimum distance of a sampled goal to the start, as both may shift while settling."""


class Rearrange(Generator):
    """Start states of a task, from its declaration."""

    def __init__(
        self,
        spec: TaskSpec,
        scenes: Sequence[str],
        load: Callable[[str], SceneSpec],
        objects: Objects,
    ) -> None:
        """Takes the task, and the arguments of every generator."""
        super().__init__(scenes, load, objects)
        self._spec = spec

    def attempt(self, sandbox: PlacementSandbox, rng: np.random.Generator) -> Episode:
        """Returns one candidate."""
        spec = self._spec
        spots = {s.ref: s for s in self.spots(sandbox, _receptacles(spec))}
        names = [self._name(rng, target.candidates) for target in spec.targets]
        clutter = [self._name(rng) for _ in range(spec.clutter)]
        handles = instances([*names, *clutter, *names])
        count = len(spec.targets)
        targets, ghosts = handles[:count], handles[-count:]
        sandbox.show(handles)
        at_start = self._open_at_start(sandbox, spots.values())
        joints = _merged([*(spot.joints for spot in spots.values()), at_start])
        sandbox.open_joints(joints)
        placer = Placer(sandbox, rng, self.settling)
        self._put_targets(placer, targets, list(spots.values()))
        self._put_goals(placer, targets, ghosts, list(spots.values()))
        put_all(placer, handles[count:-count], _named(spots.values(), spec.clutter_on))
        settled = placer.settle()
        goals = self._goals(settled, targets, ghosts)
        objects = {h: pose for h, pose in settled.items() if h not in ghosts}
        if any(name not in objects for name in targets):
            raise RejectedSampleError("a target does not stay at its start")
        if len(objects) - count < KEPT_CLUTTER * spec.clutter:
            raise RejectedSampleError("too much clutter fell")
        points = [sandbox.com_m(name) for name in (*targets, *ghosts)]
        pose_scene(sandbox, objects, joints)
        starts = self.starts(sandbox, rng)
        if not all(starts.stand(point) for point in points):
            raise RejectedSampleError("a start or goal is out of reach")
        if {*ARTICULATIONS, *spec.articulations} - set(spec.starts_open):
            objects = self._closed(sandbox, placer, objects)
            pose_scene(sandbox, objects, at_start)
        on = placer.on
        rearrangements = tuple(
            Rearrangement(object=target, start=on[target], goal=on[ghost], world_from_goal=goal)
            for target, ghost, goal in zip(targets, ghosts, goals, strict=True)
        )
        in_reach = KeepOff(points_m=np.concatenate([sandbox.graspable_m(), handles_m(sandbox)]))
        robot = self.starts(sandbox, rng, in_reach).anywhere()
        return start_state(sandbox, robot, objects, rearrangements)

    def _open_at_start(
        self, sandbox: PlacementSandbox, spots: Iterable[Spot]
    ) -> dict[str, dict[str, float]]:
        """Returns the joints of containers that start open, empty or not."""
        found = [s.joints for s in spots if CONTAINERS.get(s.receptacle.name) in self._starts_open]
        for name in self._starts_open:
            ref = find_articulation(sandbox, ARTICULATION_KINDS[name].marker).ref
            upper = sandbox.joint_limits(ref.furniture, ref.joint)[1]
            if not any(ref.joint in joints.get(ref.furniture, {}) for joints in found):
                wide = widest(sandbox, ref.furniture, ref.joint) if name == "fridge" else upper
                found.append({ref.furniture: {ref.joint: wide}})
        return _merged(found)

    @property
    def _starts_open(self) -> tuple[str, ...]:
        return self._spec.starts_open

    def _name(self, rng: np.random.Generator, among: tuple[str, ...] = ()) -> str:
        """Samples an object; does not advance the generator if there is only one."""
        names = among or self.objects.names
        return names[0] if len(among) == 1 else names[int(rng.integers(len(names)))]

    def _put_targets(self, placer: Placer, targets: list[str], spots: list[Spot]) -> None:
        for target, declared in zip(targets, self._spec.targets, strict=True):
            if not placer.put(target, _named(spots, declared.start)):
                raise RejectedSampleError("no room for a target at its start")

    def _put_goals(
        self, placer: Placer, targets: list[str], ghosts: list[str], spots: list[Spot]
    ) -> None:
        for target, ghost, declared in zip(targets, ghosts, self._spec.targets, strict=True):
            start = np.array(placer.placed[target][:3])
            if declared.inside is not None:
                placer.put_into(ghost, ghosts[self._spec.number(declared.inside)])
            elif not placer.put(ghost, _named(spots, declared.goal), [(start, KEEP_OFF_M)]):
                raise RejectedSampleError("no room for a target at its goal")

    def _goals(
        self, settled: dict[str, Pose7], targets: list[str], ghosts: list[str]
    ) -> list[Pose7]:
        goals = []
        for target, ghost in zip(targets, ghosts, strict=True):
            if ghost not in settled:
                raise RejectedSampleError("a target does not stay at its goal")
            goals.append(settled[ghost])
            offset = np.subtract(goals[-1][:3], settled.get(target, AWAY)[:3])
            if np.linalg.norm(offset) < LEAST_MOVE_M:
                raise RejectedSampleError("start and goal too near each other")
        return goals

    def _closed(
        self, sandbox: PlacementSandbox, placer: Placer, objects: dict[str, Pose7]
    ) -> dict[str, Pose7]:
        """Closes the drawer with its content; doors do not move objects on shelves."""
        inside = {h: pose for h, pose in objects.items() if placer.on[h][0] == DRAWER}
        if "drawer" in self._starts_open:
            return objects
        if inside:
            articulation = find_articulation(sandbox, ARTICULATION_KINDS["drawer"].marker)
            if not slides(sandbox, inside, articulation):
                raise RejectedSampleError("the drawer cannot be moved with the object")
            inside = carried(sandbox, inside, articulation, 0.0)
            pose_scene(sandbox, objects | inside, {})
            if any(sandbox.touching(name) for name in inside):
                raise RejectedSampleError("the drawer cannot be closed over the object")
        return objects | inside


def _receptacles(spec: TaskSpec) -> tuple[str, ...]:
    """Returns all receptacles that a task uses."""
    named = [name for target in spec.targets for name in (*target.start, *target.goal)]
    return tuple(dict.fromkeys([*named, *spec.clutter_on]))


def _named(spots: Iterable[Spot], names: tuple[str, ...]) -> list[Spot]:
    return [spot for spot in spots if spot.receptacle.name in names]


def _merged(parts: Iterable[dict[str, dict[str, float]]]) -> dict[str, dict[str, float]]:
    merged: dict[str, dict[str, float]] = {}
    for part in parts:
        for furniture, joints in part.items():
            merged.setdefault(furniture, {}).update(joints)
    return merged
