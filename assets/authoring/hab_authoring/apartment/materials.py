"""The palette and the semantic classes, from `materials.toml`; small procedural textures.

Textures are drawn with fixed seeds, and tile. They hold few colours, so that the embedded PNG files
stay small.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import Image
from trimesh.visual.material import PBRMaterial

from hab_authoring.apartment.model import Array, read_table

Color = tuple[float, float, float]
COLORS = 40


def _noise(rng: np.random.Generator, height: int, width: int, cells_y: int, cells_x: int) -> Array:
    """Return smooth tiling value noise in 0..1."""
    grid = rng.random((cells_y, cells_x))
    y = np.arange(height) * cells_y / height
    x = np.arange(width) * cells_x / width
    y0, x0 = y.astype(int), x.astype(int)
    fy, fx = (y - y0)[:, None], (x - x0)[None]
    fy, fx = fy * fy * (3 - 2 * fy), fx * fx * (3 - 2 * fx)
    y1, x1 = (y0 + 1) % cells_y, (x0 + 1) % cells_x
    top = grid[y0][:, x0] * (1 - fx) + grid[y0][:, x1] * fx
    low = grid[y1][:, x0] * (1 - fx) + grid[y1][:, x1] * fx
    return top * (1 - fy) + low * fy


def _image(shade: Array, dark: Color, light: Color) -> Array:
    mix = np.clip(shade, 0, 1)[..., None]
    return np.asarray(dark) * (1 - mix) + np.asarray(light) * mix


def _grain(rng: np.random.Generator, size: int, lines: int) -> Array:
    """Return wood grain that runs along u."""
    broad = _noise(rng, size, size, lines // 4, 2)
    fine = _noise(rng, size, size, lines, 4)
    hair = _noise(rng, size, size, size // 2, 6)
    rise = np.arange(size)[:, None] * 4 / size
    waves = 0.5 + 0.5 * np.sin(
        2 * np.pi * (rise + 0.55 * broad + 0.35 * _noise(rng, size, size, 3, 2))
    )
    return 0.26 * waves + 0.40 * fine + 0.34 * hair


def wood(seed: int, dark: Color, light: Color) -> Array:
    """Return plain wood."""
    rng = np.random.default_rng(seed)
    return _image(_grain(rng, 128, 24), dark, light)


def planks(seed: int, dark: Color, light: Color) -> Array:
    """Return a floor of eight rows of staggered boards."""
    rng, size, rows = np.random.default_rng(seed), 256, 8
    out = np.zeros((size, size))
    deep = size // rows
    for row in range(rows):
        cuts = (int(rng.integers(0, size)), int(rng.integers(96, 160)))
        for start, length in ((cuts[0], cuts[1]), (cuts[0] + cuts[1], size - cuts[1])):
            board = _grain(rng, size, 24)[:deep] * 0.55 + 0.45 * rng.random()
            columns = np.arange(start, start + length) % size
            out[row * deep : (row + 1) * deep, columns] = board[:, columns]
            out[row * deep : (row + 1) * deep, columns[0]] *= 0.45
        out[row * deep] *= 0.45
    return _image(out, dark, light)


def weave(seed: int, dark: Color, light: Color) -> Array:
    """Return a plain cloth weave."""
    rng, size = np.random.default_rng(seed), 64
    y, x = np.mgrid[0:size, 0:size]
    over = ((x // 4 + y // 4) % 2).astype(float)
    thread = np.where(
        over > 0, np.sin((y % 4 + 0.5) * np.pi / 4), np.sin((x % 4 + 0.5) * np.pi / 4)
    )
    return _image(0.45 * thread + 0.25 * over + 0.3 * rng.random((size, size)), dark, light)


def stone(seed: int, dark: Color, light: Color) -> Array:
    """Return polished stone with flecks."""
    rng, size = np.random.default_rng(seed), 128
    cloud = 0.5 * _noise(rng, size, size, 5, 5) + 0.3 * _noise(rng, size, size, 16, 16)
    fleck = (rng.random((size, size)) > 0.965) * 0.55
    return _image(cloud * 0.6 + fleck + 0.12 * rng.random((size, size)), dark, light)


def tiles(seed: int, dark: Color, light: Color, count: int = 2, grout: float = 0.92) -> Array:
    """Return square tiles with thin joints."""
    rng, size = np.random.default_rng(seed), 128
    edge = size // count
    shade = 0.5 + 0.25 * _noise(rng, size, size, 8, 8)
    shade += 0.25 * np.kron(rng.random((count, count)), np.ones((edge, edge)))
    image = _image(shade, dark, light)
    lines = np.arange(size) % edge < 2
    image[lines] = image[:, lines] = np.asarray(dark) * grout
    return image


def rug(seed: int, dark: Color, light: Color, accent: Color) -> Array:
    """Return a rug seen from above: a border, and a field of diamonds."""
    rng, size = np.random.default_rng(seed), 128
    y, x = np.mgrid[0:size, 0:size]
    edge = np.minimum(np.minimum(x, size - 1 - x), np.minimum(y, size - 1 - y))
    diamond = (np.abs(x % 32 - 15.5) + np.abs(y % 32 - 15.5)) / 31
    shade = 0.75 + 0.25 * rng.random((size, size))
    image = _image(shade * 0.9, dark, light)
    for mask in ((diamond > 0.42) & (diamond < 0.5) & (edge > 14), (edge > 6) & (edge < 10)):
        image[mask] = np.asarray(accent) * shade[mask][:, None]
    image[edge < 2] = np.asarray(dark)
    return image


def leaf(seed: int, dark: Color, light: Color) -> Array:
    """Return a leaf's surface, its middle rib along u at half height."""
    rng, size = np.random.default_rng(seed), 32
    y, x = np.mgrid[0:size, 0:size]
    rib = np.abs(y - 15.5) < 1
    veins = ((x + np.abs(y - 15.5)) % 8 < 1) * 0.3
    shade = 0.35 + veins + 0.5 * rib + 0.25 * _noise(rng, size, size, 8, 8)
    return _image(shade, dark, light)


def view() -> Array:
    """Return the view through a window: a pale sky over blurred trees."""
    rng, size = np.random.default_rng(19), 64
    y = np.arange(size)[:, None] / size
    image = _image(y * 1.4 + 0 * y.T, (0.56, 0.74, 0.93), (0.93, 0.96, 0.98))
    cloud = _noise(rng, size, size, 4, 3) * np.clip(1.2 - 2 * y, 0, 1)
    image = image * (1 - 0.5 * cloud[..., None]) + 0.5 * cloud[..., None]
    crown = (
        0.62 + 0.16 * _noise(rng, size, size, 1, 6)[:1] + 0.06 * _noise(rng, size, size, 1, 16)[:1]
    )
    green = _image(_noise(rng, size, size, 14, 14), (0.27, 0.42, 0.24), (0.58, 0.70, 0.45))
    cover = np.clip((y - crown) * 20, 0, 1)[..., None]
    return image * (1 - cover) + green * cover


def apple_skin() -> Array:
    """Return red skin with yellow streaks near the stalk, which is at v = 0.45."""
    rng, size = np.random.default_rng(20), 64
    v = 1 - (np.arange(size)[:, None] + 0.5) / size
    streak = 0.55 * _noise(rng, size, size, 4, 24) + 0.45 * _noise(rng, size, size, 3, 6)
    near = np.clip(1 - np.abs(v - 0.42) / 0.16, 0, 1) + 0.5 * np.clip(1 - v / 0.1, 0, 1)
    return _image(near * (0.25 + streak), (0.62, 0.06, 0.06), (0.92, 0.68, 0.22))


def canvas(seed: int, palette: Sequence[Color]) -> Array:
    """Return an abstract painting: hills under a low sun."""
    rng, size = np.random.default_rng(seed), 128
    y, x = np.mgrid[0:size, 0:size]
    image = _image(y / size, palette[0], palette[1])
    image[(x - 84) ** 2 + (y - 38) ** 2 < 17**2] = palette[2]
    for k, color in enumerate(palette[3:]):
        base = 58 + 18 * k
        wave = 9 * np.sin(x / (17.0 + 6 * k) + 1.7 * k) + 4 * np.sin(x / 7.0 + k)
        image[y > base + wave] = color
    return np.clip(image * (0.96 + 0.06 * rng.random((size, size, 1))), 0, 1)


def drawn(function: str, *arguments: Any) -> Image.Image:
    """Return the texture that a function of this module draws."""
    return _to_image(globals()[function](*arguments))


def _to_image(rgb: Array) -> Image.Image:
    """Return an 8-bit palette image, without dithering, whose bytes depend on the input alone."""
    data = np.round(np.clip(rgb, 0, 1) * 255).astype(np.uint8)
    image = Image.fromarray(data, "RGB")
    return image.quantize(COLORS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)


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
    image = material.texture and drawn(*TABLES["textures"][material.texture])
    return PBRMaterial(
        name=name,
        baseColorFactor=[*material.color, material.alpha],
        metallicFactor=material.metallic,
        roughnessFactor=material.roughness,
        baseColorTexture=image,
        emissiveFactor=None if material.glow is None else list(material.glow),
        alphaMode="BLEND" if material.alpha < 1 else "OPAQUE",
    )
