"""Options of the asset pipeline."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

from hab_tasks.errors import HabError, UnknownNameError

COLLISIONS = ("coacd", "hull", "merged-hull", "box")
TEXTURE_FORMATS = ("ktx2", "png")

LARGEST_TEXTURE_PX = 16384

_VERSION = 1
"""Version in every cache name; incrementing it invalidates the cache."""


@dataclass(frozen=True, kw_only=True)
class AssetOptions:
    """Options of one copy.

    Attributes:
        collision: How collision parts are made, one of `COLLISIONS`.
        recompute: Whether they are made from the visual meshes where the dataset brings convex
            parts of its own, too.
        decimate: Wanted share of the triangles of a visual mesh, in (0, 1].
        texture_px: Largest width and height of a texture.
        texture_format: One of `TEXTURE_FORMATS`.
    """

    collision: str = "coacd"
    recompute: bool = False
    decimate: float = 0.5
    texture_px: int = 1024
    texture_format: str = "ktx2"

    def __post_init__(self) -> None:
        """Raises HabError for invalid values."""
        if self.collision not in COLLISIONS:
            raise UnknownNameError("--collision", self.collision, COLLISIONS)
        if self.texture_format not in TEXTURE_FORMATS:
            raise UnknownNameError("--texture-format", self.texture_format, TEXTURE_FORMATS)
        if not 0 < self.decimate <= 1:
            raise HabError(f"--decimate {self.decimate}: a share of the triangles, in (0, 1].")
        if not 4 <= self.texture_px <= LARGEST_TEXTURE_PX:
            raise HabError(f"--texture-size {self.texture_px}: 4 to {LARGEST_TEXTURE_PX} pixels.")

    @property
    def visual_key(self) -> str:
        """Cache key of visual meshes, without their sources."""
        return f"{_VERSION}-{self.decimate:g}-{self.texture_px}-{self.texture_format}"

    @property
    def collision_key(self) -> str:
        """Cache key of collision parts, without their sources."""
        return f"{_VERSION}-{self.collision}{'-recomputed' if self.recompute else ''}"

    def to_json(self) -> str:
        """Returns all options as a JSON object."""
        return json.dumps(asdict(self), indent=2)
