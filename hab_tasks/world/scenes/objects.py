"""Movable objects of the tasks: 13 YCB objects, embedded or from the user's YCB folder.

Three sources are supported: the embedded look-alikes in a scene dataset's own templates, YCB's
``NNN_name/google_16k/`` folders (masses from URDFs beside them), and ManiSkill's
``mani_skill2_ycb/models`` (densities from its ``info_pick_v0.json``).
"""

from __future__ import annotations

import re
from pathlib import Path

from hab_tasks.errors import DatasetError, UnknownNameError
from hab_tasks.object_names import ALL_OBJECTS
from hab_tasks.world.scenes.fields import Fields, check_number, is_present, read_fields, read_urdf
from hab_tasks.world.scenes.habitat.dataset import SceneDataset, embedded_dataset, maniskill_folder
from hab_tasks.world.scenes.habitat.load import load_template
from hab_tasks.world.scenes.meshes import check_mesh, parts_file
from hab_tasks.world.scenes.spec import CollisionSource, ObjectTemplate
from hab_tasks.world.scenes.urdf_checks import as_number

YCB_UP = (0.0, 0.0, 1.0)
YCB_FRICTION = 0.6
DEFAULT_DENSITY_KG_M3 = 500.0


def load_objects(folder: str | Path | None) -> dict[str, ObjectTemplate]:
    """Returns the 13 objects by YCB name.

    Args:
        folder: None for the embedded look-alikes, ``ycb`` for what ManiSkill has downloaded, else
            a YCB folder in either layout.

    Raises:
        UnknownNameError: `folder` does not exist.
        DatasetError: An object is absent or damaged, or ManiSkill has not downloaded them.
    """
    if folder is None:
        return _embedded_objects()
    root = resolve_objects(folder)
    return _ycb_objects(root)


def resolve_objects(name_or_path: str | Path) -> Path:
    """Returns the folder for ``ycb``, as ManiSkill has downloaded it, or for a folder's path.

    Raises:
        UnknownNameError: Neither the known name nor an existing folder.
        DatasetError: ManiSkill has not downloaded it.
    """
    root = Path(name_or_path).expanduser()
    if not root.is_dir() and str(name_or_path) == "ycb":
        return maniskill_folder("ycb")
    if not root.is_dir():
        valid = ["ycb", "PATH of a YCB folder (omit for embedded)"]
        raise UnknownNameError("objects", str(name_or_path), valid)
    return root


def _embedded_objects() -> dict[str, ObjectTemplate]:
    dataset = SceneDataset(embedded_dataset())
    found = {}
    for name in ALL_OBJECTS:
        file = dataset.object_files.get(name)
        template = load_template(file) if file else None
        if template is None:
            raise DatasetError(f"{dataset.root}: the embedded object {name} is absent.")
        found[name] = template
    return found


def _ycb_objects(root: Path) -> dict[str, ObjectTemplate]:
    of_maniskill = (root / "models").is_dir()
    masses_kg = {} if of_maniskill else _urdf_masses(root)
    info = Fields(root / "info_pick_v0.json", {})
    if of_maniskill and is_present(info.file):
        info = read_fields(info.file)
    found = {}
    for name in ALL_OBJECTS:
        meshes = root / "models" / name if of_maniskill else root / name / "google_16k"
        visual = meshes / "textured.obj"
        collision = meshes / ("collision.ply" if of_maniskill else "textured_vhacd.stl")
        if not (of_maniskill or is_present(collision)):
            collision = visual
        for file in (visual, collision):
            if not is_present(file):
                raise DatasetError(f"{root}: object {name} has no {file.relative_to(root)}.")
            check_mesh(file)
        parts, volume_m3 = parts_file(collision)
        about = info.part(name, optional=True)
        density_kg_m3 = about.number("density", DEFAULT_DENSITY_KG_M3, above=0.0)
        found[name] = ObjectTemplate(
            name=name,
            visual_file=visual,
            collision=(CollisionSource(kind="convex_parts", file=parts),),
            mass_kg=masses_kg.get(name, volume_m3 * density_kg_m3),
            friction=YCB_FRICTION,
            up=YCB_UP,
        )
    return found


def _urdf_masses(root: Path) -> dict[str, float]:
    """Masses [kg] from URDFs that lie beside the object folders and name a mesh in them."""
    masses = {}
    for file in sorted(root.glob("*.urdf")):
        tree = read_urdf(file)
        mesh, mass = next(tree.iter("mesh"), None), next(tree.iter("mass"), None)
        match = re.search(r"\d{3}_\w+", mesh.get("filename", "")) if mesh is not None else None
        if match and mass is not None:
            value = as_number(mass.get("value"))
            masses[match[0]] = check_number(file, "mass value", value, above=0.0)
    return masses
