"""Micro-variations of a macro layout (S A.1): swap at least two pieces, perturb some of the others.

Two pieces that change places keep their backs where the other's back was, against its wall if it
stood at one. What stands on a piece goes with it. Every step is refused that makes the layout
worse to use than the macro layout (`layout_checks.Baseline`).
"""

from __future__ import annotations

import math
import re
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from hab_tasks.errors import GenerationError, UnknownNameError
from hab_tasks.geometry import Pose7, from_matrix, to_matrix
from hab_tasks.privileged import Array
from hab_tasks.scenes.dataset import SceneDataset
from hab_tasks.scenes.furnishing import Piece, find_pieces, flat_bodies
from hab_tasks.scenes.layout_checks import Baseline, Fault
from hab_tasks.scenes.layout_geometry import Bodies, Layout
from hab_tasks.scenes.load import load_scene
from hab_tasks.scenes.settled import SINK_M, planar, settled
from hab_tasks.scenes.write import moved_scene

MACRO = re.compile(r"^v3_(sc\d)_staging_00$")

FREE_SPACE = "piece without free space"
"""Counted when no attempt to swap or perturb found room for a piece."""


@dataclass(frozen=True, kw_only=True)
class VaryConfig:
    """How far pieces move.

    Attributes:
        shift_m: A free-standing piece moves by at most this much.
        turn_rad: And turns by at most this much.
        slide_m: A piece against a wall slides along it by at most this much.
        least_m: A perturbed piece moves by at least this much.
        perturb_share: Chance of each piece that is not swapped to be perturbed.
        two_swaps_share: Chance of two pairs changing places instead of one.
        sidestep_m: A swapped piece may stand this much beside the middle of its new place.
        wall_gap_m: A swapped piece keeps at least this distance from the wall.
        sink_m: A piece may press this deep into a rug.
        tries: Proposals for each swap or perturbation.
        attempts: Arrangements before giving up.
    """

    shift_m: float = 0.3
    turn_rad: float = math.radians(20.0)
    slide_m: float = 0.5
    least_m: float = 0.05
    perturb_share: float = 0.5
    two_swaps_share: float = 0.3
    sidestep_m: float = 0.3
    wall_gap_m: float = 0.01
    sink_m: float = SINK_M
    tries: int = 4
    attempts: int = 200


@dataclass(frozen=True, kw_only=True)
class Variation:
    """A micro-variation.

    Attributes:
        scene: Its scene_instance file.
        swapped: Pairs of handles that changed places.
        perturbed: Handles that moved a little.
        rejections: Reasons for which steps were refused on the way.
    """

    scene: dict[str, Any]
    swapped: tuple[tuple[str, str], ...]
    perturbed: tuple[str, ...]
    rejections: Counter[str]


def macro_scene_id(dataset: SceneDataset, name: str) -> str:
    """Returns the scene id of a macro layout given by its id or by its short name, as ``sc1``.

    Raises:
        UnknownNameError: The dataset has no such macro layout.
    """
    macros = {match[1]: s for s in dataset.scene_files if (match := MACRO.match(s))}
    if name in macros.values():
        return name
    if name not in macros:
        raise UnknownNameError(f"macro layout in {dataset.root}", name, [*macros, *macros.values()])
    return macros[name]


def vary_layout(
    dataset: SceneDataset, macro_scene_id: str, seed: int, index: int
) -> dict[str, Any]:
    """Returns the scene_instance file of one micro-variation.

    Raises:
        UnknownNameError: The dataset has no such macro layout.
        GenerationError: No arrangement passed the checks; the message counts the reasons.
    """
    return LayoutVarier(dataset, macro_scene_id).make(seed, index).scene


class LayoutVarier:
    """Makes micro-variations of one macro layout."""

    def __init__(self, dataset: SceneDataset, macro: str, config: VaryConfig | None = None) -> None:
        """Loads and measures the macro layout (its id, or short as ``sc1``)."""
        self.dataset = dataset
        self.scene_id = macro_scene_id(dataset, macro)
        self.config = config or VaryConfig()
        self.spec = load_scene(dataset, self.scene_id)
        self.layout = Layout.of(self.spec)
        self.pieces = find_pieces(self.layout)
        self.baseline = Baseline(self.layout)
        self.flat = Bodies(flat_bodies(self.layout))

    def make(self, seed: int, index: int) -> Variation:
        """Makes variation number `index`; the same whatever else is made.

        Raises:
            GenerationError: No arrangement passed the checks; the message counts the reasons.
        """
        rng = np.random.default_rng((seed, index, zlib.crc32(self.scene_id.encode())))
        refused: Counter[str] = Counter()
        for _ in range(self.config.attempts):
            arrangement = _Arrangement(self, rng, refused)
            if arrangement.find():
                return Variation(
                    scene=moved_scene(self.dataset, self.spec, arrangement.poses()),
                    swapped=tuple(arrangement.swapped),
                    perturbed=tuple(arrangement.perturbed),
                    rejections=refused,
                )
        raise GenerationError(
            f"{self.scene_id}: no micro-variation in {self.config.attempts} attempts; refused: "
            f"{dict(refused)}."
        )


class _Arrangement:
    """One attempt: pieces moved so far, each at most once."""

    def __init__(
        self, varier: LayoutVarier, rng: np.random.Generator, refused: Counter[str]
    ) -> None:
        self._of, self._rng, self._refused = varier, rng, refused
        self._config = varier.config
        self._layout = varier.layout
        self._motions: dict[str, Array] = {}
        self.swapped: list[tuple[str, str]] = []
        self.perturbed: list[str] = []

    def find(self) -> bool:
        """Swaps and perturbs; returns whether the result passed all checks."""
        config, rng = self._config, self._rng
        self._swap_some(2 if rng.random() < config.two_swaps_share else 1)
        if not self.swapped:
            return False
        taken = {name for pair in self.swapped for name in pair}
        others = [piece for piece in self._of.pieces if piece.name not in taken]
        rng.shuffle(others)
        chosen = [piece for piece in others if rng.random() < config.perturb_share]
        for piece in chosen or others[:1]:
            if any(self._move({piece: self._nudge(piece)}) for _ in range(config.tries)):
                self.perturbed.append(piece.name)
        if not self.perturbed:
            self._refused[FREE_SPACE] += 1
            return False
        return not self._refuse(self._of.baseline.cramped(self._layout, self._motions))

    def poses(self) -> dict[str, Pose7]:
        """Returns handle -> new pose of everything that moved."""
        items = {item.name: item.world_from_object for item in self._of.spec.objects}
        items |= {item.name: item.world_from_root for item in self._of.spec.articulations}
        return {
            name: from_matrix(motion @ to_matrix(items[name]))
            for name, motion in self._motions.items()
        }

    def _swap_some(self, count: int) -> None:
        pieces = [piece for piece in self._of.pieces if piece.swappable]
        pairs = [(a, b) for a, b in combinations(pieces, 2) if a.template != b.template]
        self._rng.shuffle(pairs)
        for first, second in pairs:
            if len(self.swapped) == count:
                return
            if first.name in self._motions or second.name in self._motions:
                continue
            for _ in range(self._config.tries):
                there, back = self._onto(first, second), self._onto(second, first)
                if self._move({first: there, second: back}):
                    self.swapped.append((first.name, second.name))
                    break
        self._refused[FREE_SPACE] += not self.swapped

    def _onto(self, piece: Piece, place: Piece) -> Array:
        """Returns the motion that puts `piece` where `place` stands."""
        config, back = self._config, place.back
        across = np.array((-back[1], back[0]))
        step = config.sidestep_m + abs(piece.half_m[1] - place.half_m[1])
        center = place.center_m + across * self._rng.uniform(-step, step)
        if place.wall_gap_m is not None:
            gap = max(place.wall_gap_m, config.wall_gap_m)
            wall = place.half_m[0] + place.wall_gap_m
            center = center + back * (wall - gap - piece.half_m[0])
        turn = math.atan2(back[1], back[0]) - math.atan2(piece.back[1], piece.back[0])
        return self._settled(piece, planar(piece.center_m, center, turn))

    def _nudge(self, piece: Piece) -> Array:
        """Returns a small motion: along the wall, or anywhere on the floor and turned."""
        config, rng = self._config, self._rng
        if piece.wall_gap_m is not None:
            length = rng.uniform(config.least_m, config.slide_m) * rng.choice((-1.0, 1.0))
            shift, turn = length * np.array((-piece.back[1], piece.back[0])), 0.0
        else:
            angle = rng.uniform(-math.pi, math.pi)
            length = rng.uniform(config.least_m, config.shift_m)
            shift = length * np.array((math.cos(angle), math.sin(angle)))
            turn = rng.uniform(-config.turn_rad, config.turn_rad)
        return self._settled(piece, planar(piece.center_m, piece.center_m + shift, turn))

    def _settled(self, piece: Piece, motion: Array) -> Array:
        own = self._of.layout.of_pieces([piece.name]).all
        return settled(own, motion, self._of.flat, self._config.sink_m)

    def _move(self, motions: Mapping[Piece, Array]) -> bool:
        """Moves pieces, and what goes with them, if they fit; returns whether they did."""
        new = {name: motion for piece, motion in motions.items() for name in piece.members}
        layout = self._layout.moved(new)
        baseline = self._of.baseline
        if self._refuse(baseline.overlapping(layout, new)):
            return False
        if self._refuse(baseline.blocked(layout, new)):
            return False
        self._layout = layout
        self._motions |= new
        return True

    def _refuse(self, faults: Iterator[Fault]) -> bool:
        """Whether there is a fault; counts the first."""
        fault = next(faults, None)
        if fault is not None:
            self._refused[fault.kind] += 1
        return fault is not None
