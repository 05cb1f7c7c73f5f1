"""Validation of URDFs: one tree of links, valid numbers, solid shapes.

The engine accepts most invalid URDFs and silently drops a joint, a shape or a mass.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from hab_tasks.errors import DatasetError, UnknownNameError
from hab_tasks.world.scenes.fields import check_number, check_numbers, is_present, refused

JOINT_TYPES = ("fixed", "prismatic", "revolute", "continuous")
"""Supported types; the engine's loader drops others (``planar``, ``floating``)."""

LIMITED = ("prismatic", "revolute")
SHAPES = {"box": (), "sphere": ("radius",), "cylinder": ("radius", "length"), "mesh": ()}
"""Shape -> its sizes that are one number."""

DEEPEST = 32
"""Maximum nesting depth of elements; a URDF needs six."""

_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def check_robot(file: Path, root: Element) -> None:
    """Checks a URDF whose numbers are separated by blanks; meshes are only checked to exist.

    Raises:
        DatasetError: The engine could not build it completely.
    """
    if root.tag != "robot":
        raise refused(file, "its root element", root.tag, "'robot'")
    _check_depth(file, root)
    links, joints = root.findall("link"), root.findall("joint")
    if not links or not joints:
        raise DatasetError(f"{file}: no {'joint' if links else 'link'} in it.")
    for kind, elements in (("link", links), ("joint", joints)):
        _check_names(file, kind, elements)
    for link in links:
        _check_link(file, link)
    for joint in joints:
        _check_joint(file, joint, [link.get("name", "") for link in links], joints)
    _check_tree(file, links, joints)


def mesh_file(file: Path, mesh: Element) -> Path:
    """Returns the file that a mesh element names.

    Raises:
        DatasetError: It names none, or one that is absent.
    """
    name = mesh.get("filename", "")
    try:
        path = (file.parent / name).resolve()
        if name and is_present(path):
            return path
    except (OSError, RuntimeError, ValueError, DatasetError) as error:
        raise refused(
            file, "the filename of a mesh", name, f"the name of a file ({error})"
        ) from error
    raise DatasetError(f"{file}: names {name!r}, which does not exist.")


def _check_depth(file: Path, root: Element) -> None:
    level = [root]
    for _ in range(DEEPEST):
        level = [child for element in level for child in element]
    if level:
        raise DatasetError(f"{file}: its elements are nested more than {DEEPEST} deep.")


def _check_names(file: Path, kind: str, elements: Iterable[Element]) -> None:
    counts = Counter(element.get("name", "") for element in elements)
    if "" in counts:
        raise DatasetError(f"{file}: a {kind} has no name.")
    twice = [name for name, count in counts.items() if count > 1]
    if twice:
        raise DatasetError(f"{file}: {kind} {twice[0]!r} is there {counts[twice[0]]} times.")


def _check_link(file: Path, link: Element) -> None:
    location = f"link {link.get('name')!r}"
    for inertial in link.findall("inertial"):
        _check_inertial(file, f"{location}, inertial", inertial)
    for kind in ("visual", "collision"):
        for number, body in enumerate(link.findall(kind)):
            where = f"{location}, {kind} {number}"
            _check_origin(file, where, body)
            _check_geometry(file, where, body.find("geometry"))
            for color in body.iterfind("material/color"):
                _numbers(file, where, color, "rgba", 4)


def _check_inertial(file: Path, location: str, inertial: Element) -> None:
    _check_origin(file, location, inertial)
    mass = _only(file, location, inertial, "mass")
    inertia = _only(file, location, inertial, "inertia")
    mass_kg = _number(file, f"{location}, mass", mass, "value", least=0.0)
    values = [_number(file, f"{location}, inertia", inertia, name) for name in _INERTIA]
    xx, xy, xz, yy, yz, zz = values
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if mass_kg > 0 and any(values) and not moments.min() > 0:
        raise refused(file, f"{location}, inertia", values, "positive definite")


def _check_geometry(file: Path, location: str, geometry: Element | None) -> None:
    shapes = [] if geometry is None else list(geometry)
    if len(shapes) != 1 or shapes[0].tag not in SHAPES:
        found = [shape.tag for shape in shapes]
        raise refused(file, f"{location}, geometry", found, f"one of {', '.join(sorted(SHAPES))}")
    shape = shapes[0]
    where = f"{location}, {shape.tag}"
    for name in SHAPES[shape.tag]:
        _number(file, where, shape, name, above=0.0)
    if shape.tag == "box" and min(_numbers(file, where, shape, "size", 3)) <= 0:
        raise refused(file, f"{where} size", shape.get("size"), "3 numbers above 0")
    if shape.tag == "mesh":
        mesh_file(file, shape)
        if shape.get("scale") is not None and 0.0 in _numbers(file, where, shape, "scale", 3):
            raise refused(file, f"{where} scale", shape.get("scale"), "3 numbers other than 0")


def _check_joint(file: Path, joint: Element, links: list[str], joints: list[Element]) -> None:
    location, kind = f"joint {joint.get('name')!r}", joint.get("type")
    if kind not in JOINT_TYPES:
        raise DatasetError(f"{file}: {location}: {UnknownNameError('type', kind, JOINT_TYPES)}")
    _check_origin(file, location, joint)
    for end in ("parent", "child"):
        link = _only(file, location, joint, end).get("link")
        if link not in links:
            raise DatasetError(
                f"{file}: {location}: {UnknownNameError(f'{end} link', link, links)}"
            )
    axis = joint.find("axis")
    if (
        axis is not None
        and not math.hypot(*_numbers(file, f"{location}, axis", axis, "xyz", 3)) > 0
    ):
        raise refused(file, f"{location}, axis", axis.get("xyz"), "3 numbers that are not all zero")
    _check_limit(file, location, joint, needed=kind in LIMITED)
    for dynamics in joint.findall("dynamics"):
        for name in ("damping", "friction"):
            _number(file, f"{location}, dynamics", dynamics, name, "0", least=0.0)
    for mimic in joint.findall("mimic"):
        names = [other.get("name", "") for other in joints]
        if mimic.get("joint") not in names:
            error = UnknownNameError("joint to mimic", mimic.get("joint"), names)
            raise DatasetError(f"{file}: {location}: {error}")
        for name in ("multiplier", "offset"):
            _number(file, f"{location}, mimic", mimic, name, "0")


def _check_limit(file: Path, location: str, joint: Element, *, needed: bool) -> None:
    if not needed and joint.find("limit") is None:
        return
    limit = _only(file, location, joint, "limit")
    for name in ("effort", "velocity"):  # any number will do: nothing uses it
        if not isinstance(as_number(limit.get(name, "0")), float):
            raise refused(file, f"{location}, limit {name}", limit.get(name), "a number")
    lower, upper = (_number(file, f"{location}, limit", limit, n, "0") for n in ("lower", "upper"))
    if needed and lower > upper:
        raise refused(file, f"{location}, limit", f"{lower:g} to {upper:g}", "lower before upper")


def _check_origin(file: Path, location: str, element: Element) -> None:
    for origin in element.findall("origin"):
        for name in ("xyz", "rpy"):
            if origin.get(name) is not None:
                _numbers(file, f"{location}, origin", origin, name, 3)


def _check_tree(file: Path, links: list[Element], joints: list[Element]) -> None:
    """Checks that the links form one tree."""
    children: dict[str, list[str]] = {link.get("name", ""): [] for link in links}
    ends = [[joint.find(end) for end in ("parent", "child")] for joint in joints]
    pairs = [[end.get("link", "") for end in pair if end is not None] for pair in ends]
    held = Counter(child for _, child in pairs)
    for name, count in held.items():
        if count > 1:
            raise DatasetError(f"{file}: link {name!r} is the child of {count} joints.")
    for parent, child in pairs:
        children[parent].append(child)
    roots = [name for name in children if name not in held]
    if len(roots) > 1:
        raise DatasetError(f"{file}: links {', '.join(map(repr, roots[:3]))} hang on no joint.")
    reached = roots[:]
    for name in reached:
        reached.extend(children[name])
    if len(reached) < len(children):
        circle = sorted(set(children) - set(reached))
        raise DatasetError(f"{file}: link {circle[0]!r} hangs on itself through its joints.")


def _only(file: Path, location: str, element: Element, tag: str) -> Element:
    found = element.findall(tag)
    if len(found) != 1:
        raise DatasetError(f"{file}: {location}: {len(found)} elements <{tag}>; it has to be one.")
    return found[0]


def _number(
    file: Path,
    location: str,
    element: Element,
    name: str,
    default: str | None = None,
    *,
    above: float = -math.inf,
    least: float = -math.inf,
) -> float:
    text = element.get(name, default)
    return check_number(file, f"{location} {name}", as_number(text), above=above, least=least)


def _numbers(
    file: Path, location: str, element: Element, name: str, count: int
) -> tuple[float, ...]:
    values = [as_number(text) for text in element.get(name, "").split()]
    return check_numbers(file, f"{location} {name}", values, count)


def as_number(text: str | None) -> float | str | None:
    """Returns the number in a text, or the text itself if it is not a number."""
    try:
        return float(text or "")
    except ValueError:
        return text
