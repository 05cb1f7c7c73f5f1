"""Micro-variations of a macro layout (S A.1): swap at least two pieces, perturb some of the others.

Two pieces that swap positions put their back where the other's back was, against its wall if it had
one. Objects on a piece move with it. Steps that make the layout less usable than the macro layout
are rejected (`hab_authoring.layouts.checks.Baseline`).
"""

from __future__ import annotations

import math
import zlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from hab_authoring.inventory import macro_layouts, macro_of
from hab_authoring.layouts.checks import Baseline, is_refused
from hab_authoring.layouts.furnishing import Piece, find_pieces, flat_bodies
from hab_authoring.layouts.overlaps import SINK_M, Bodies, pieces_of, planar, rearranged, settled
from hab_authoring.layouts.write import moved_scene
from hab_tasks.errors import GenerationError, UnknownNameError
from hab_tasks.privileged import Array
from hab_tasks.world.scenes.habitat.dataset import SceneDataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.layout_geometry import Layout

FREE_SPACE = "piece without free space"
"""Rejection reason: no attempt to swap or perturb found room for a piece."""


@dataclass(frozen=True, kw_only=True)
class VaryConfig:
    """Parameters of micro-variations.

    Attributes:
        shift_m: Maximum displacement of a free-standing piece.
        turn_rad: Maximum rotation of a free-standing piece.
        slide_m: Maximum displacement of a piece along its wall.
        least_m: Minimum displacement of a perturbed piece.
        perturb_share: Probability that a piece that is not swapped is perturbed.
        two_swaps_share: Probability of two swaps instead of one.
        sidestep_m: Maximum offset of a swapped piece from the centre of its new position.
        wall_gap_m: Minimum distance of a swapped piece to the wall.
        sink_m: Maximum penetration of a piece into a rug.
        tries: Proposals per swap or perturbation.
        attempts: Maximum number of arrangements.
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
        swapped: Pairs of pieces (names) that swapped positions.
        perturbed: Handles of perturbed pieces.
        rejections: Rejected steps by reason.
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
    macros = {str(macro_of(s)): s for s in macro_layouts(dataset)}
    if name in macros.values():
        return name
    if name not in macros:
        raise UnknownNameError(f"macro layout in {dataset.root}", name, [*macros, *macros.values()])
    return macros[name]


class LayoutVarier:
    """Generates micro-variations of one macro layout."""

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
        """Generates variation number `index`, independent of other variations.

        Raises:
            GenerationError: No arrangement passed the checks; the message counts the reasons.
        """
        rng = np.random.default_rng((seed, index, zlib.crc32(self.scene_id.encode())))
        refused: Counter[str] = Counter()
        for _ in range(self.config.attempts):
            arrangement = _Arrangement(self, rng, refused)
            if arrangement.find():
                return Variation(
                    scene=moved_scene(self.dataset, self.spec, arrangement.motions),
                    swapped=tuple(arrangement.swapped),
                    perturbed=tuple(arrangement.perturbed),
                    rejections=refused,
                )
        raise GenerationError(
            f"{self.scene_id}: no micro-variation in {self.config.attempts} attempts; rejected: "
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
        self.motions: dict[str, Array] = {}
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
        return not is_refused(self._refused, self._of.baseline.cramped(self._layout, self.motions))

    def _swap_some(self, count: int) -> None:
        pieces = [piece for piece in self._of.pieces if piece.swappable]
        pairs = [(a, b) for a, b in combinations(pieces, 2) if a.template != b.template]
        self._rng.shuffle(pairs)
        for first, second in pairs:
            if len(self.swapped) == count:
                return
            if first.name in self.motions or second.name in self.motions:
                continue
            for _ in range(self._config.tries):
                there, back = self._onto(first, second), self._onto(second, first)
                if self._move({first: there, second: back}):
                    self.swapped.append((first.name, second.name))
                    break
        self._refused[FREE_SPACE] += not self.swapped

    def _onto(self, piece: Piece, other: Piece) -> Array:
        """Returns the motion that moves `piece` to the position of `other`."""
        config, back = self._config, other.back
        across = np.array((-back[1], back[0]))
        step = config.sidestep_m + abs(piece.half_m[1] - other.half_m[1])
        center = other.center_m + across * self._rng.uniform(-step, step)
        if other.wall_gap_m is not None:
            gap = max(other.wall_gap_m, config.wall_gap_m)
            wall = other.half_m[0] + other.wall_gap_m
            center = center + back * (wall - gap - piece.half_m[0])
        turn = math.atan2(back[1], back[0]) - math.atan2(piece.back[1], piece.back[0])
        return self._settled(piece, planar(piece.center_m, center, turn))

    def _nudge(self, piece: Piece) -> Array:
        """Returns a small motion: along the wall, or a displacement on the floor with rotation."""
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
        own = pieces_of(self._of.layout, [piece.name]).all
        return settled(own, motion, self._of.flat, self._config.sink_m)

    def _move(self, motions: Mapping[Piece, Array]) -> bool:
        """Moves pieces and their members if they fit; returns whether they did."""
        new = {name: motion for piece, motion in motions.items() for name in piece.members}
        layout = rearranged(self._layout, new)
        baseline = self._of.baseline
        if is_refused(self._refused, baseline.overlapping(layout, new)):
            return False
        if is_refused(self._refused, baseline.blocked(layout, new)):
            return False
        self._layout = layout
        self.motions |= new
        return True
