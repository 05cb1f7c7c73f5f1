"""The palette and the semantic classes, from `materials.toml`."""

from collections.abc import Sequence
from dataclasses import dataclass

from trimesh.visual.material import PBRMaterial

from hab_authoring.apartment import textures
from hab_authoring.apartment.model import read_table


@dataclass(frozen=True)
class Material:
    """Base colour, metalness and roughness, with an optional tiling texture."""

    color: Sequence[float] = (1.0, 1.0, 1.0)
    roughness: float = 0.6
    metallic: float = 0.0
    alpha: float = 1.0
    texture: str | None = None
    tile_m: float = 1.0
    glow: Sequence[float] | None = None


TABLES = read_table("materials.toml")
MATERIALS = {name: Material(**fields) for name, fields in TABLES["materials"].items()}
CLASSES: dict[str, int] = TABLES["classes"]


def lexicon(categories: set[str]) -> dict[str, list[dict[str, str | int]]]:
    """Return Habitat's lexicon of the classes among `categories`, by id."""
    return {"classes": [{"name": n, "id": k} for n, k in CLASSES.items() if n in categories]}


def to_pbr(name: str) -> PBRMaterial:
    """Return the glTF material of that name."""
    material = MATERIALS[name]
    image = material.texture and textures.drawn(*TABLES["textures"][material.texture])
    return PBRMaterial(
        name=name,
        baseColorFactor=[*material.color, material.alpha],
        metallicFactor=material.metallic,
        roughnessFactor=material.roughness,
        baseColorTexture=image,
        emissiveFactor=None if material.glow is None else list(material.glow),
        alphaMode="BLEND" if material.alpha < 1 else "OPAQUE",
    )
