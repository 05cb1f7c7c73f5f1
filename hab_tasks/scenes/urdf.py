"""URDFs as SAPIEN can load them: commas mended, meshes by absolute path, visuals on request.

ReplicaCAD's URDFs hold ``scale="1, 1, 1"``, which numpy 2 refuses. Mended copies lie in the cache,
keyed by content; the dataset's own files stay as they are. Without a renderer SAPIEN cannot even
make a material, so the copy for headless use has no visuals at all.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree

from hab_tasks.errors import DatasetError
from hab_tasks.scenes.meshes import cached_file, check_mesh

_NUMERIC = ("xyz", "rpy", "scale", "size", "value", "rgba")


@lru_cache(maxsize=512)
def check_urdf(file: Path) -> None:
    """Raises DatasetError when a URDF does not parse or names a mesh that is absent or damaged."""
    for mesh in _parse(file).iter("mesh"):
        path = (file.parent / mesh.get("filename", "")).resolve()
        if not path.exists():
            raise DatasetError(f"{file}: names {mesh.get('filename')!r}, which does not exist.")
        check_mesh(path)


@lru_cache(maxsize=512)
def sapien_urdf(file: Path, visuals: bool) -> Path:
    """Returns a copy of the URDF that SAPIEN loads, with or without visual meshes."""
    root = _parse(file)
    mend_numbers(root)
    for dynamics in root.iter("dynamics"):
        dynamics.attrib.setdefault("damping", "0")  # ManiSkill cannot do without
    for mesh in root.iter("mesh"):
        mesh.set("filename", str((file.parent / mesh.get("filename", "")).resolve()))
    if not visuals:
        remove_visuals(root)
    return write_urdf(root, file.stem)


def write_urdf(root: ElementTree.Element, stem: str) -> Path:
    """Writes a URDF tree to the cache under a name made from its content; returns the file."""
    text = ElementTree.tostring(root, encoding="unicode")
    key = hashlib.sha256(text.encode()).hexdigest()[:20]

    def write(path: Path) -> None:
        path.write_text(text)

    return cached_file(f"urdf/{key}/{stem}.urdf", write)


def mend_numbers(root: ElementTree.Element) -> None:
    """Replaces commas between numbers by blanks, in place."""
    for element in root.iter():
        for attribute in _NUMERIC:
            if element.get(attribute) is not None:
                element.set(
                    attribute, " ".join(element.get(attribute, "").replace(",", " ").split())
                )


def remove_visuals(root: ElementTree.Element) -> None:
    """Deletes every visual, in place."""
    for link in root.iter("link"):
        for visual in link.findall("visual"):
            link.remove(visual)


def joint_limits(file: Path) -> dict[str, tuple[float, float]]:
    """Returns joint name -> (lower, upper) [m or rad] of the movable joints, before scaling."""
    limits = {}
    for joint in _parse(file).iter("joint"):
        limit = joint.find("limit")
        if joint.get("type") in ("revolute", "prismatic") and limit is not None:
            limits[joint.get("name", "")] = (
                float(limit.get("lower", 0)),
                float(limit.get("upper", 0)),
            )
    return limits


def joint_frictions(file: Path) -> dict[str, float]:
    """Returns joint name -> friction [N or N m] of the joints that state one."""
    stated = {}
    for joint in _parse(file).iter("joint"):
        dynamics = joint.find("dynamics")
        if dynamics is not None and dynamics.get("friction") is not None:
            stated[joint.get("name", "")] = float(dynamics.get("friction", 0))
    return stated


def _parse(file: Path) -> ElementTree.Element:
    try:
        return ElementTree.parse(file).getroot()
    except FileNotFoundError as error:
        raise DatasetError(f"{file}: no such file.") from error
    except ElementTree.ParseError as error:
        raise DatasetError(f"{file}: not a valid URDF ({error}).") from error
