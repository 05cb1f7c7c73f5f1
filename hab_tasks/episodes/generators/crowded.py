"""Clutter added to an episode that is otherwise left as it is."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np

from hab_tasks.episodes.generators.base import Generator, Made, pose_scene, refuse_unrest
from hab_tasks.episodes.placing import AWAY, Disc, Placer
from hab_tasks.episodes.robot_start import START_CLEARANCE_M, KeepOff, ee_in_world
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import Episode
from hab_tasks.episodes.spots import Spot, opening_joints, spot_of
from hab_tasks.errors import GenerationError, OptionError, RejectedSampleError
from hab_tasks.geometry import Pose7, apply

ATTEMPTS = 20

AS_OPEN = 0.1
"""Maximum distance [m or rad] of a container's joint from its open position."""

STILL_M = 0.001
"""Maximum displacement of what was there before, while the new objects settle."""


def crowded(generator: Generator, episode: Episode, count: int, seed: tuple[int, ...]) -> Made:
    """Adds objects on the receptacles where objects of an episode start and go.

    Args:
        generator: Generator of the episode.
        episode: The episode.
        count: Number of objects; there are fewer if there is no room for more.
        seed: The only source of randomness.

    Raises:
        OptionError: The episode has no such receptacle that is open.
        GenerationError: Every attempt was rejected.
    """
    rng, refused = np.random.default_rng(seed), Counter[str]()
    sandbox = generator.new_sandbox(generator.load(episode.scene_id))
    for _ in range(ATTEMPTS):
        try:
            made = _attempt(generator, sandbox, rng, episode, count)
            refuse_unrest(sandbox, made)
        except RejectedSampleError as reason:
            refused[str(reason)] += 1
            continue
        return Made(episode=made, rejections=refused)
    raise GenerationError(f"{episode.id}: no room for clutter; rejected: {dict(refused)}.")


def _attempt(
    generator: Generator,
    sandbox: PlacementSandbox,
    rng: np.random.Generator,
    episode: Episode,
    count: int,
) -> Episode:
    """Returns the episode with further objects.

    Raises:
        RejectedSampleError: They move other objects or touch the robot.
    """
    before = {name: pose for name, pose in episode.objects.items() if name != episode.held}
    new = _instances(generator, rng, episode, count)
    pose_scene(sandbox, dict.fromkeys([*new, *episode.objects], AWAY) | before, episode.joints)
    spots = _spots(sandbox, episode)
    if not spots:
        valid = "0 where no object starts or goes in the open"
        raise OptionError.of_value("perturbation.clutter", count, valid)
    taken = _taken(sandbox, episode, before, spots)
    placer = Placer(sandbox, rng, generator.settling)
    for name in new:
        placer.put(name, spots, taken)
    added = placer.settle()
    after = {**before, **{n: p for n, p in sandbox.settled.items() if n in episode.loose}}
    if any(math.dist(sandbox.pose(name)[:3], pose[:3]) > STILL_M for name, pose in after.items()):
        raise RejectedSampleError("clutter moves other objects")
    arm_rad = episode.robot.arm_pose(generator.objects.robot)
    hand_m = ee_in_world(generator.kinematics, episode.robot.base, arm_rad)
    # The hand grasps what is nearest, so nothing new may be where it starts.
    off = {name for name in added if KeepOff(points_m=sandbox.com_m(name)[None]).meets(hand_m)}
    added = {name: pose for name, pose in added.items() if name not in off}
    pose_scene(sandbox, before | added, episode.joints)
    if sandbox.robot_touches(episode.robot.base, arm_rad, START_CLEARANCE_M):
        raise RejectedSampleError("clutter touches the robot")
    return replace(episode, objects={**episode.objects, **added})


def _instances(
    generator: Generator, rng: np.random.Generator, episode: Episode, count: int
) -> list[str]:
    """Samples objects; returns names of instances that the episode does not have."""
    found: list[str] = []
    for template in rng.choice(generator.objects.names, size=count):
        taken, number = {*episode.objects, *found}, 0
        while f"{template}_:{number:04d}" in taken:
            number += 1
        found.append(f"{template}_:{number:04d}")
    return found


def _spots(sandbox: PlacementSandbox, episode: Episode) -> list[Spot]:
    """Returns the receptacles of the episode's objects that are open at the start."""
    refs = {ref for target in episode.targets for ref in (target.start, target.goal)}
    found = [one for one in sandbox.spec.receptacles if (one.name, one.body) in refs]
    ordered = sorted(found, key=lambda one: (one.name, one.body))

    def is_open(furniture: str, joint: str, value: float) -> bool:
        return abs(episode.joints.get(furniture, {}).get(joint, 0.0) - value) < AS_OPEN

    return [
        spot_of(sandbox, one, {})
        for one in ordered
        if all(
            is_open(furniture, joint, value)
            for furniture, joints in opening_joints(sandbox, one).items()
            for joint, value in joints.items()
        )
    ]


def _taken(
    sandbox: PlacementSandbox, episode: Episode, before: dict[str, Pose7], spots: list[Spot]
) -> list[Disc]:
    """Returns discs around the objects of an episode and their goals, at the height of spots."""
    goals = {t.object: t.world_from_goal for t in episode.targets if t.world_from_goal is not None}
    found = []
    for name, pose in (*before.items(), *goals.items()):
        middle_m, radius_m, _ = sandbox.footprint(name)
        at_m = apply(pose, middle_m[None])[0]
        found += [(np.array((at_m[0], at_m[1], spot.center_m[2])), radius_m) for spot in spots]
    return found
