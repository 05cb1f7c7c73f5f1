"""Merging of links on fixed joints, which the engine would simulate in every step."""

from __future__ import annotations

import warnings
from collections.abc import Collection
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from hab_tasks.geometry import Array

_AXES = ("x", "y", "z")


@dataclass(frozen=True, kw_only=True)
class Inertial:
    """Mass properties of a link.

    Attributes:
        mass_kg: Mass.
        com_m: (3,) centre of mass in the link's frame.
        inertia_kg_m2: (3, 3) inertia about the centre of mass, along the link's axes.
    """

    mass_kg: float
    com_m: Array
    inertia_kg_m2: Array

    def moved(self, parent_from_link: Array) -> Inertial:
        """Returns the same body in the parent's frame; `parent_from_link` is (4, 4)."""
        rotation = parent_from_link[:3, :3]
        return Inertial(
            mass_kg=self.mass_kg,
            com_m=rotation @ self.com_m + parent_from_link[:3, 3],
            inertia_kg_m2=rotation @ self.inertia_kg_m2 @ rotation.T,
        )

    def joined(self, other: Inertial) -> Inertial:
        """Returns both bodies as one, by the parallel axis theorem."""
        mass_kg = self.mass_kg + other.mass_kg
        com_m = (self.mass_kg * self.com_m + other.mass_kg * other.com_m) / mass_kg
        inertia = sum(
            (part.inertia_kg_m2 + _of_point(part.mass_kg, part.com_m - com_m))
            for part in (self, other)
        )
        return Inertial(mass_kg=mass_kg, com_m=com_m, inertia_kg_m2=np.asarray(inertia))


def merge_fixed_links(root: ElementTree.Element, keep: Collection[str] = ()) -> None:
    """Merges every link of a URDF on a fixed joint into its parent, in place, but those to `keep`.

    The parent gets its mass, visuals and collision shapes; joints to further links start at the
    parent.
    """
    links = {link.get("name"): link for link in root.findall("link")}
    for joint in root.findall("joint"):
        child, parent = (_end(joint, tag) for tag in ("child", "parent"))
        if joint.get("type") != "fixed" or child in keep:
            continue
        parent_from_child = _origin(joint)
        _merge(links[child], links[parent], parent_from_child)
        for other in root.findall("joint"):
            if _end(other, "parent") == child:
                other.find("parent").set("link", parent)  # type: ignore[union-attr]
                _move(other, parent_from_child)
        root.remove(joint)
        root.remove(links[child])


def _merge(
    child: ElementTree.Element, parent: ElementTree.Element, parent_from_child: Array
) -> None:
    """Moves the elements of a link to its parent."""
    for element in [*child.findall("visual"), *child.findall("collision")]:
        _move(element, parent_from_child)
        parent.append(element)
    added = _read_inertial(child)
    if added is not None:
        added = added.moved(parent_from_child)
        own = _read_inertial(parent)
        _write_inertial(parent, added if own is None else own.joined(added))


def _end(joint: ElementTree.Element, tag: str) -> str:
    found = joint.find(tag)
    return "" if found is None else found.get("link", "")


def _move(element: ElementTree.Element, parent_from_child: Array) -> None:
    """Expresses the origin of an element in the parent's frame."""
    pose = parent_from_child @ _origin(element)
    origin = element.find("origin")
    if origin is None:
        origin = ElementTree.SubElement(element, "origin")
    origin.set("xyz", _text(pose[:3, 3]))
    with warnings.catch_warnings():  # at a pitch of 90 degrees, any of the right angles will do
        warnings.filterwarnings("ignore", "Gimbal lock", UserWarning)
        origin.set("rpy", _text(Rotation.from_matrix(pose[:3, :3]).as_euler("xyz")))


def _origin(element: ElementTree.Element) -> Array:
    """Returns the pose (4, 4) of an element's origin, which is the identity if absent."""
    pose, origin = np.eye(4), element.find("origin")
    if origin is not None:
        pose[:3, 3] = _numbers(origin.get("xyz", "0 0 0"))
        pose[:3, :3] = Rotation.from_euler("xyz", _numbers(origin.get("rpy", "0 0 0"))).as_matrix()
    return pose


def _read_inertial(link: ElementTree.Element) -> Inertial | None:
    """Returns the mass properties of a link, along its own axes; None if it has none."""
    element = link.find("inertial")
    if element is None:
        return None
    mass, inertia = element.find("mass"), element.find("inertia")
    if mass is None or inertia is None:
        return None
    matrix = np.zeros((3, 3))
    for row, first in enumerate(_AXES):
        for column, second in enumerate(_AXES):
            name = "i" + "".join(sorted(first + second))
            matrix[row, column] = float(inertia.get(name, 0.0))
    own = Inertial(mass_kg=float(mass.get("value", 0.0)), com_m=np.zeros(3), inertia_kg_m2=matrix)
    return own.moved(_origin(element))


def _write_inertial(link: ElementTree.Element, inertial: Inertial) -> None:
    element = link.find("inertial")
    if element is not None:
        link.remove(element)
    element = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(element, "origin", xyz=_text(inertial.com_m), rpy="0 0 0")
    ElementTree.SubElement(element, "mass", value=repr(inertial.mass_kg))
    inertia = ElementTree.SubElement(element, "inertia")
    for row, first in enumerate(_AXES):
        for column in range(row, 3):
            value = float(inertial.inertia_kg_m2[row, column])
            inertia.set(f"i{first}{_AXES[column]}", repr(value))


def _of_point(mass_kg: float, at_m: Array) -> Array:
    """Returns the inertia (3, 3) of a point mass about the origin."""
    return mass_kg * (float(at_m @ at_m) * np.eye(3) - np.outer(at_m, at_m))


def _numbers(text: str) -> list[float]:
    return [float(part) for part in text.split()]


def _text(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)
