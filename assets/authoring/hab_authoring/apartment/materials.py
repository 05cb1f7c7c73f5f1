"""The palette: every surface of the flat is one of these physically based materials."""

from dataclasses import dataclass

from trimesh.visual.material import PBRMaterial

from hab_authoring.apartment import textures

White = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Material:
    """Base colour, metalness and roughness, with an optional tiling texture."""

    color: tuple[float, float, float] = White
    roughness: float = 0.6
    metallic: float = 0.0
    alpha: float = 1.0
    texture: str | None = None
    tile_m: float = 1.0
    glow: tuple[float, float, float] | None = None


MATERIALS: dict[str, Material] = {
    # Building
    "wall": Material((0.87, 0.85, 0.80), 0.9),
    "wall_edge": Material((0.93, 0.92, 0.89), 0.8),
    "trim": Material((0.92, 0.91, 0.88), 0.45),
    "floor_planks": Material(roughness=0.42, texture="planks", tile_m=1.6),
    "floor_pale": Material(roughness=0.45, texture="planks_pale", tile_m=1.6),
    "floor_dark": Material(roughness=0.4, texture="planks_dark", tile_m=1.6),
    "floor_tile": Material(roughness=0.3, texture="floor_tile", tile_m=0.8),
    "floor_slate": Material(roughness=0.35, texture="floor_slate", tile_m=1.2),
    "floor_carpet": Material(roughness=1.0, texture="cream_cloth", tile_m=0.25),
    "wall_tile": Material(roughness=0.2, texture="wall_tile", tile_m=0.4),
    "glass": Material((0.75, 0.87, 0.92), 0.05, alpha=0.25),
    "wall_sage": Material((0.60, 0.66, 0.60), 0.9),
    "wall_blue": Material((0.50, 0.59, 0.67), 0.9),
    "wall_clay": Material((0.72, 0.49, 0.38), 0.9),
    "wall_ochre": Material((0.80, 0.66, 0.42), 0.9),
    "wall_plum": Material((0.50, 0.40, 0.47), 0.9),
    "view": Material((0.75, 0.75, 0.75), 1.0, texture="view", glow=(0.28, 0.30, 0.32)),
    "door_paint": Material((0.88, 0.86, 0.81), 0.4),
    # Furniture
    "oak": Material(roughness=0.5, texture="oak", tile_m=0.7),
    "walnut": Material(roughness=0.45, texture="walnut", tile_m=0.7),
    "birch": Material(roughness=0.55, texture="birch", tile_m=0.7),
    "sofa_cloth": Material(roughness=0.95, texture="sofa_cloth", tile_m=0.12),
    "chair_cloth": Material(roughness=0.95, texture="chair_cloth", tile_m=0.12),
    "cream_cloth": Material(roughness=0.95, texture="cream_cloth", tile_m=0.10),
    "rust_cloth": Material(roughness=0.95, texture="rust_cloth", tile_m=0.10),
    "bag_cloth": Material((0.30, 0.42, 0.44), 0.95),
    "linen": Material((0.88, 0.87, 0.84), 0.95),
    "duvet": Material((0.43, 0.52, 0.58), 0.95),
    "rug_large": Material(roughness=1.0, texture="rug_large"),
    "rug_small": Material(roughness=1.0, texture="rug_small"),
    "rug_edge": Material((0.45, 0.40, 0.34), 1.0),
    "mat_weave": Material(roughness=1.0, texture="mat_weave", tile_m=0.15),
    "black_metal": Material((0.05, 0.05, 0.055), 0.4, 0.6),
    "steel": Material((0.62, 0.63, 0.64), 0.3, 0.75),
    "brass": Material((0.80, 0.62, 0.32), 0.3, 0.9),
    "white_lacquer": Material((0.90, 0.90, 0.88), 0.35),
    "gap": Material((0.03, 0.03, 0.03), 0.9),
    "screen": Material((0.02, 0.02, 0.025), 0.12),
    "black_plastic": Material((0.06, 0.06, 0.065), 0.5),
    "lamp_shade": Material((0.95, 0.88, 0.74), 0.9, glow=(0.45, 0.36, 0.22)),
    "ceramic": Material((0.86, 0.83, 0.78), 0.35),
    "terracotta": Material((0.66, 0.36, 0.23), 0.8),
    "soil": Material((0.12, 0.085, 0.06), 1.0),
    "leaf": Material(roughness=0.55, texture="leaf"),
    "bark": Material((0.30, 0.21, 0.13), 0.9),
    "painting_01": Material(roughness=0.8, texture="painting_01"),
    "painting_02": Material(roughness=0.8, texture="painting_02"),
    "painting_03": Material(roughness=0.8, texture="painting_03"),
    "paper": Material((0.90, 0.88, 0.82), 0.9),
    # Kitchen
    "cabinet_front": Material((0.42, 0.50, 0.47), 0.5),
    "cabinet_body": Material((0.82, 0.81, 0.77), 0.6),
    "plinth": Material((0.16, 0.17, 0.17), 0.7),
    "worktop": Material(roughness=0.22, texture="worktop", tile_m=0.6),
    "fridge_shell": Material((0.70, 0.72, 0.74), 0.34, 0.3),
    "fridge_liner": Material((0.93, 0.94, 0.94), 0.4),
    "shelf_glass": Material((0.78, 0.90, 0.92), 0.08, alpha=0.45),
    "gasket": Material((0.35, 0.36, 0.37), 0.8),
    # Pickable things
    "can_metal": Material((0.78, 0.78, 0.76), 0.3, 0.9),
    "label_blue": Material((0.11, 0.25, 0.55), 0.5),
    "label_red": Material((0.74, 0.10, 0.09), 0.5),
    "label_cream": Material((0.93, 0.89, 0.77), 0.55),
    "label_yellow": Material((0.93, 0.74, 0.13), 0.5),
    "label_green": Material((0.16, 0.46, 0.22), 0.5),
    "label_brown": Material((0.36, 0.19, 0.10), 0.55),
    "label_white": Material((0.94, 0.94, 0.92), 0.5),
    "label_pink": Material((0.86, 0.34, 0.42), 0.5),
    "label_teal": Material((0.08, 0.45, 0.48), 0.5),
    "label_orange": Material((0.90, 0.45, 0.10), 0.5),
    "plastic_lid": Material((0.86, 0.86, 0.84), 0.5),
    "apple_skin": Material(roughness=0.35, texture="apple_skin", tile_m=0.236),
    "orange_peel": Material((0.95, 0.48, 0.05), 0.55),
    "stalk": Material((0.25, 0.17, 0.08), 0.8),
    "bowl_red": Material((0.72, 0.11, 0.10), 0.3),
    "mug_glaze": Material((0.16, 0.33, 0.52), 0.3),
    "mug_inside": Material((0.92, 0.90, 0.86), 0.3),
    "sponge_yellow": Material((0.93, 0.80, 0.25), 1.0),
    # Loose things
    "glaze_white": Material((0.91, 0.90, 0.87), 0.25),
    "glaze_blue": Material((0.22, 0.36, 0.56), 0.3),
    "glaze_sage": Material((0.50, 0.60, 0.50), 0.35),
    "glaze_rust": Material((0.66, 0.32, 0.20), 0.35),
    "enamel_red": Material((0.60, 0.07, 0.06), 0.2),
    "amber": Material((0.42, 0.20, 0.05), 0.15),
    "spice": Material((0.62, 0.30, 0.10), 0.4),
    "plastic_white": Material((0.90, 0.90, 0.89), 0.4),
    "plastic_grey": Material((0.42, 0.43, 0.44), 0.5),
    "wool_grey": Material((0.45, 0.46, 0.48), 0.95),
    "towel_blue": Material((0.52, 0.66, 0.74), 0.98),
    "coat_navy": Material((0.10, 0.14, 0.24), 0.95),
    "leather": Material((0.40, 0.22, 0.11), 0.5),
    "rubber": Material((0.05, 0.05, 0.05), 0.8),
    "wicker": Material(roughness=0.8, texture="wicker", tile_m=0.10),
    "cardboard": Material((0.66, 0.50, 0.34), 0.9),
    "paint_teal": Material((0.07, 0.38, 0.42), 0.25),
    "paint_red": Material((0.68, 0.08, 0.06), 0.25),
    "photo": Material(roughness=0.5, texture="photo"),
    "sponge_green": Material((0.14, 0.42, 0.22), 1.0),
}


def to_pbr(name: str) -> PBRMaterial:
    """Return the glTF material of that name."""
    material = MATERIALS[name]
    image = (
        None
        if material.texture is None
        else textures.to_image(textures.TEXTURES[material.texture]())
    )
    return PBRMaterial(
        name=name,
        baseColorFactor=[*material.color, material.alpha],
        metallicFactor=material.metallic,
        roughnessFactor=material.roughness,
        baseColorTexture=image,
        emissiveFactor=None if material.glow is None else list(material.glow),
        alphaMode="BLEND" if material.alpha < 1 else "OPAQUE",
    )
