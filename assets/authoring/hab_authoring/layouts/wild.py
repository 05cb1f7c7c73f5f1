"""Wild layouts: furniture and kitchen anywhere along the walls, to test the robot's robustness.

All movable pieces are removed, then placed one by one: first the kitchen, with the fridge mostly in
a corner that blocks its door, then the others, so that they leave narrow aisles. Other rules are
those of micro-variations: objects on a piece move with it, nothing overlaps, task drawers open
fully, and the robot reaches all that it reaches in the macro layout
(`hab_authoring.layouts.checks.WILD`).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from hab_authoring.inventory import macro_layouts
from hab_authoring.layouts.checks import FRIDGE_HINGE, WILD, Baseline, free_range, is_refused
from hab_authoring.layouts.furnishing import COUNTER, Piece, find_pieces, flat_bodies
from hab_authoring.layouts.overlaps import Bodies, bodies_of, pieces_of, planar, rearranged, settled
from hab_authoring.layouts.standing import ROOM_DOORS, FloorPlan, narrowest_aisle_m
from hab_authoring.layouts.wild_poses import PiecePose, PoseSampler, crowding
from hab_authoring.layouts.write import moved_scene
from hab_tasks.articulations import FRIDGES
from hab_tasks.errors import GenerationError
from hab_tasks.privileged import Array
from hab_tasks.world.scenes.fields import read_json
from hab_tasks.world.scenes.habitat.dataset import SceneDataset
from hab_tasks.world.scenes.habitat.load import read_scene
from hab_tasks.world.scenes.layout_geometry import Joint, Layout
from hab_tasks.world.scenes.walls import inner_walls, walls_without

MIRRORED = "fridge_mirrored"
NARROW_SHELVES = "frl_apartment_wall_cabinet_01"
SPACING_M = 0.32
"""Vertical distance of its boards."""

_AWAY = np.eye(4)
_AWAY[0, 3] = 1000.0

FULL = "no place for a piece"
"""Rejection reason: no feasible pose was found for a piece."""


@dataclass(frozen=True, kw_only=True)
class WildConfig:
    """Parameters of wild layouts.

    Attributes:
        hinge_corner_share: Share of fridges whose door is blocked by a corner.
        other_corner_share: Share of fridges with the other side to a corner.
        door_rad: Range of angles at which the door is blocked.
        mirrored_share: Share of fridges with mirrored hinges, if the dataset has one.
        stays_share: Probability that a piece, except the kitchen, keeps its pose.
        free_share: Probability of a free-standing pose for pieces that stood free.
        away_share: Probability of a free-standing pose for pieces that stood at a wall.
        fridge_tries, kitchen_tries, tries: Maximum number of poses tried per piece.
        looked_at: Number of sampled poses; those with narrow aisles are tried first.
        chance_m: Noise of that order.
        attempts: Maximum number of arrangements.
        step_rad: Resolution of the door's measured free range.
        shelves_m: Largest height by which the narrow shelves hang higher.
    """

    hinge_corner_share: float = 0.7
    other_corner_share: float = 0.15
    door_rad: tuple[float, float] = (1.65, 2.3)
    mirrored_share: float = 0.5
    stays_share: float = 0.15
    free_share: float = 0.6
    away_share: float = 0.15
    fridge_tries: int = 40
    kitchen_tries: int = 60
    tries: int = 20
    looked_at: int = 60
    chance_m: float = 0.2
    attempts: int = 400
    step_rad: float = 0.01
    shelves_m: float = 0.0


HANDLES_IN_CORNERS = WildConfig(hinge_corner_share=0.0, other_corner_share=1.0)
"""Every fridge has something tall beside its handle."""


@dataclass(frozen=True, kw_only=True)
class WildLayout:
    """A wild layout.

    Attributes:
        scene: Its scene_instance file.
        macro: Scene id of the macro layout that has its furniture.
        fridge: Template of its fridge.
        door_rad: Maximum opening of the fridge's upper door.
        aisle_m: See `narrowest_aisle_m`.
        rejections: Rejected poses by reason.
    """

    scene: dict[str, Any]
    macro: str
    fridge: str
    door_rad: float
    aisle_m: float
    rejections: Counter[str]


class WildVarier:
    """Generates wild layouts of a dataset."""

    def __init__(
        self,
        dataset: SceneDataset,
        macros: Sequence[str] | None = None,
        config: WildConfig | None = None,
    ) -> None:
        """Prepares to sample from macro layouts (their scene ids), or from all.

        Raises:
            GenerationError: The dataset has no macro layouts.
        """
        self.dataset = dataset
        self.config = config or WildConfig()
        self.macros = macro_layouts(dataset) if macros is None else list(macros)
        if not self.macros:
            raise GenerationError(f"{dataset.root}: no macro layouts to draw from.")
        mirrored = MIRRORED in dataset.urdf_files
        self._mirrored_share = self.config.mirrored_share if mirrored else 0.0
        self._emptied: dict[tuple[str, bool], Emptied] = {}

    def make(self, seed: int, index: int) -> WildLayout:
        """Generates layout number `index`, independent of other layouts.

        Raises:
            GenerationError: No arrangement passed the checks; the message counts the reasons.
        """
        rng = np.random.default_rng((seed, index, len(self.macros)))
        refused: Counter[str] = Counter()
        for _ in range(self.config.attempts):
            macro = self.macros[int(rng.integers(len(self.macros)))]
            emptied = self.emptied(macro, bool(rng.random() < self._mirrored_share))
            arrangement = _Arrangement(emptied, self.config, rng, refused)
            if arrangement.find():
                return self._layout(emptied, arrangement, refused)
        raise GenerationError(
            f"{self.dataset.root}: no wild layout in {self.config.attempts} attempts; rejected: "
            f"{dict(refused)}."
        )

    def emptied(self, macro: str, mirrored: bool) -> Emptied:
        """Returns a macro layout without its movable pieces; cached."""
        key = (macro, mirrored)
        if key not in self._emptied:
            self._emptied[key] = Emptied(self.dataset, macro, mirrored)
        return self._emptied[key]

    def _layout(
        self, emptied: Emptied, arrangement: _Arrangement, refused: Counter[str]
    ) -> WildLayout:
        layout = arrangement.layout
        joint = emptied.hinge(layout)
        motions = arrangement.motions | arrangement.raised_shelves()
        return WildLayout(
            scene=moved_scene(self.dataset, emptied.spec, motions, emptied.scene),
            macro=emptied.spec.scene_id,
            fridge=emptied.fridge.template,
            door_rad=free_range(joint, bodies_of(layout), self.config.step_rad).upper,
            aisle_m=narrowest_aisle_m(emptied.baseline.plan.floor(arrangement.motions)),
            rejections=refused,
        )


class Emptied:
    """A macro layout without its movable pieces.

    Attributes:
        scene: Its scene_instance file, with the mirrored fridge if requested.
        spec, layout: Content of that file; inner walls are complete behind movable pieces.
        pieces: Movable pieces: all in the robot's room.
        away: Motions that move all of them out of the room.
        fridge, counter: The kitchen's pieces.
        baseline: Reference for the checks of layouts.
        sampler: Sampler of poses.
        flat: Rugs and mats.
    """

    def __init__(self, dataset: SceneDataset, macro: str, mirrored: bool) -> None:
        """Reads and measures the macro layout."""
        self.scene = read_json(dataset.scene_file(macro))
        if mirrored:
            for entry in self.scene["articulated_object_instances"]:
                if entry["template_name"] in FRIDGES:
                    entry["template_name"] = MIRRORED
        spec = read_scene(dataset, macro, self.scene)
        shell = spec.stage
        read = partial(read_scene, dataset.source)
        convex = all(source.kind == "convex_parts" for source in shell.collision)
        if not convex:
            walls = inner_walls(dataset, spec, read)
            spec = replace(spec, stage=replace(shell, collision=shell.collision + walls))
        layout = Layout.of(spec)
        found = find_pieces(layout, ROOM_DOORS)
        if not convex:
            moved = {name for piece in found for name in piece.members}
            walls = walls_without(dataset, replace(spec, stage=shell), read, moved)
            spec = replace(spec, stage=replace(shell, collision=shell.collision + walls))
            layout = Layout.of(spec)
        self.spec, self.layout = spec, layout
        self.sampler = PoseSampler(layout, FloorPlan(layout))
        self.flat = Bodies(flat_bodies(layout))
        here = [
            p for p in found if self.sampler.holds(p, PiecePose(center_m=p.center_m, back=p.back))
        ]
        kitchen = [p for p in found if p.template in (*FRIDGES, COUNTER)]
        self.pieces = [*kitchen, *(p for p in here if p not in kitchen)]
        self.away = dict.fromkeys((n for p in self.pieces for n in p.members), _AWAY)
        self.baseline = Baseline(layout, WILD, self.away)
        self.fridge = next(p for p in kitchen if p.template in FRIDGES)
        self.counter = next(p for p in kitchen if p.template == COUNTER)
        across = np.array((-self.fridge.back[1], self.fridge.back[0]))
        hinge_m = self.hinge(layout).world_from_joint[:2, 3]
        self.hinge_beside_m = float((hinge_m - self.fridge.center_m) @ across)

    def hinge(self, layout: Layout) -> Joint:
        """Returns the joint of the fridge's upper door."""
        return next(
            j for j in layout.joints if j.name == FRIDGE_HINGE and j.piece == self.fridge.name
        )


@dataclass
class _Arrangement:
    """One attempt: pieces are placed one by one.

    Attributes:
        layout: The layout; pieces that are not placed yet are far away.
        motions: Name -> (4, 4) motion of every movable object.
    """

    of: Emptied
    config: WildConfig
    rng: np.random.Generator
    refused: Counter[str]
    motions: dict[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.motions = dict(self.of.away)
        self._absent = set(self.motions)
        self.layout: Layout = rearranged(self.of.layout, self.motions)
        self._floor = self.of.baseline.plan.floor(self.motions)

    def find(self) -> bool:
        """Furnishes the layout; returns whether the result passed all checks."""
        for piece in self._order():
            if not self._put(piece):
                self.refused[FULL] += 1
                return False
        return not is_refused(self.refused, self.of.baseline.cramped(self.layout, self.motions))

    def raised_shelves(self) -> dict[str, Array]:
        """Draws the height of the narrow shelves; returns their motions (4, 4)."""
        found = (piece for piece in self.of.pieces if piece.template == NARROW_SHELVES)
        shelves = next(found, None)
        if shelves is None or not self.config.shelves_m:
            return {}
        lift = np.eye(4)
        lift[2, 3] = self.rng.uniform(0.0, self.config.shelves_m)
        return {name: lift @ self.motions[name] for name in shelves.members}

    def _order(self) -> list[Piece]:
        """Returns the kitchen, then pieces in noisy order of decreasing size."""
        kitchen = [self.of.fridge, self.of.counter]
        self.rng.shuffle(kitchen)  # pyright: ignore[reportArgumentType]
        others = [piece for piece in self.of.pieces if piece not in kitchen]
        size = {p.name: p.half_m[0] * p.half_m[1] * self.rng.uniform(0.5, 1.5) for p in others}
        return [*kitchen, *sorted(others, key=lambda piece: -size[piece.name])]

    def _put(self, piece: Piece) -> bool:
        """Places a piece; returns whether there was room."""
        kitchen = piece in (self.of.fridge, self.of.counter)
        if not kitchen and self.rng.random() < self.config.stays_share:
            stay = PiecePose(center_m=piece.center_m, back=piece.back)
            if self._try(piece, stay):
                return True
        if piece is self.of.fridge:
            poses: list[PiecePose] = list(islice(self._fridge_poses(), self.config.fridge_tries))
        else:
            tries = self.config.kitchen_tries if kitchen else self.config.tries
            seen = islice(self._poses(piece), 20 * self.config.looked_at)
            inside = (p for p in seen if self.of.sampler.holds(piece, p))
            held = list(islice(inside, self.config.looked_at))
            chance = self.rng.uniform(0.0, self.config.chance_m, len(held))
            worth = [crowding(piece, p, self._floor) + c for p, c in zip(held, chance, strict=True)]
            poses = [held[i] for i in np.argsort(worth)[:tries]]
        return any(self._try(piece, pose) for pose in poses)

    def _fridge_poses(self) -> Iterator[PiecePose]:
        config, kind = self.config, self.rng.random()
        of, fridge = self.of, self.of.fridge
        if kind < config.hinge_corner_share + config.other_corner_share:
            found = of.sampler.in_corners(
                fridge,
                of.hinge_beside_m,
                self.layout,
                self.rng,
                config.door_rad,
                kind < config.hinge_corner_share,
            )
        else:
            found = of.sampler.at_walls(fridge, self.rng, tall=True)
        return (p for p in islice(found, 2000) if of.sampler.holds(fridge, p))

    def _poses(self, piece: Piece) -> Iterator[PiecePose]:
        config, rng, sampler = self.config, self.rng, self.of.sampler
        if piece is self.of.counter:
            return sampler.at_walls(piece, rng, tall=True)
        jointed = any(joint.piece == piece.name for joint in self.layout.joints)
        share = config.free_share if piece.wall_gap_m is None else config.away_share
        free, walls = sampler.free(piece, rng), sampler.at_walls(piece, rng)
        return iter(lambda: next(free if not jointed and rng.random() < share else walls), None)

    def _try(self, piece: Piece, pose: PiecePose) -> bool:
        """Puts a piece at a pose if it fits; returns whether it did."""
        turn = math.atan2(pose.back[1], pose.back[0]) - math.atan2(piece.back[1], piece.back[0])
        motion = planar(piece.center_m, pose.center_m, turn)
        own = pieces_of(self.of.layout, [piece.name]).all
        motion = settled(own, motion, self.of.flat)
        new = dict.fromkeys(piece.members, motion)
        layout = rearranged(self.of.layout, self.motions | new)
        baseline, absent = self.of.baseline, self._absent - set(piece.members)
        if is_refused(self.refused, baseline.overlapping(layout, new)):
            return False
        if self.of.fridge.name not in absent and self._door_stops(layout):
            return False
        if is_refused(self.refused, baseline.blocked(layout, new)):
            return False
        floor = baseline.plan.floor(self.motions | new)
        if is_refused(self.refused, baseline.crowded(layout, floor, absent)):
            return False
        self.layout, self._floor, self._absent = layout, floor, absent
        self.motions |= new
        return True

    def _door_stops(self, layout: Layout) -> bool:
        found = free_range(self.of.hinge(layout), bodies_of(layout))
        stops = found.upper < WILD.fridge_rad
        if stops:
            self.refused["blocked joint"] += 1
        return stops
