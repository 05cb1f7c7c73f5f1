"""The two-door refrigerator, and its mirrored variant with the hinges on the other side.

The frame of the body link has +x out of the doors, -z up and +y along the wall, so heights are
negative z. The root is 1.01 m above the floor. The variants differ in the sign of the doors' y
coordinates and of their axes.
"""

import math
from typing import Any

from hab_authoring.apartment import shapes
from hab_authoring.apartment.builder import Builder
from hab_authoring.apartment.model import Articulation, Joint, Link, Receptacle

RIGHT_ANGLE_RAD = math.pi / 2
HALF_WIDTH_M, FRONT_M, BACK_M, TOP_M, BOTTOM_M = 0.345, 0.3165, -0.3165, -0.955, 0.950
WALL_M = 0.030
ROOT_HEIGHT_M = 1.01
# Upper face and lower face of every shelf; the divider lies behind the seam of the doors.
SHELVES_M = {"top": (-0.610, -0.590), "middle_top": (-0.240, -0.220), "middle": (-0.047, -0.027)}
DIVIDER_M = (0.135, 0.165)
CEILING_M, FLOOR_M = TOP_M + WALL_M, BOTTOM_M - 0.040
SHELF_FRONT_M = 0.255


def build(name: str = "fridge", side: float = 1.0) -> Articulation:
    """Return the refrigerator with its hinges at +y, or at -y where `side` is -1."""
    return Articulation(
        name,
        "frl_apartment_refrigerator",
        [
            Link("root"),
            _body(),
            _door("top_door", 8.0, (-0.5715, 0.5315), (-0.06, 0.46), side),
            _door("bottom_door", 6.0, (-0.365, 0.405), (-0.33, 0.07), side),
        ],
        [
            Joint("root_rotation", "fixed", "root", "body", rpy=(RIGHT_ANGLE_RAD, 0.0, 0.0)),
            Joint(
                "top_door_hinge",
                "revolute",
                "body",
                "top_door",
                (0.322, side * 0.353, -0.385),
                axis=(0.0, 0.0, side),
                upper=2.3,
            ),
            Joint(
                "bottom_door_hinge",
                "revolute",
                "body",
                "bottom_door",
                (0.322, side * 0.353, 0.531),
                axis=(0.0, 0.0, side),
                upper=2.5,
            ),
        ],
        _receptacles(),
    )


def _body() -> Link:
    make, w, inner = Builder(), HALF_WIDTH_M, HALF_WIDTH_M - WALL_M
    shell, back = "fridge_shell", BACK_M + WALL_M
    make.span((BACK_M, -w, TOP_M), (FRONT_M, w, CEILING_M), shell)
    make.span((BACK_M, -w, FLOOR_M), (FRONT_M, w, BOTTOM_M), shell)
    make.span((BACK_M, -inner, CEILING_M), (back, inner, FLOOR_M), shell)
    for side in (-1.0, 1.0):
        low, high = sorted((side * inner, side * w))
        make.span((BACK_M, low, CEILING_M), (FRONT_M, high, FLOOR_M), shell)
    _liner(make, back, inner)
    for top, bottom in SHELVES_M.values():
        make.span((back, -inner, top), (SHELF_FRONT_M, inner, bottom), "shelf_glass", 0.002)
        low, high = (SHELF_FRONT_M - 0.004, -inner, top - 0.001), (0.263, inner, bottom + 0.004)
        make.span(low, high, "steel", 0.002, solid=False)
    low, high = (back, -inner, DIVIDER_M[0]), (FRONT_M - 0.01, inner, DIVIDER_M[1])
    make.span(low, high, "fridge_liner")
    # Plinth down to the floor, set back behind the door like a kick space.
    low, high = (BACK_M + 0.02, -w + 0.02, BOTTOM_M), (FRONT_M - 0.03, w - 0.02, ROOT_HEIGHT_M)
    make.span(low, high, "plinth", 0.002)
    return Link("body", 70.0, make.parts, make.boxes)


def _liner(make: Builder, back: float, inner: float) -> None:
    """Line the walls with thin white sheets, and add the ceiling lamp."""
    for y in (-inner, inner):
        low, high = (back, y - 0.002, CEILING_M), (FRONT_M - 0.004, y + 0.002, FLOOR_M)
        make.span(low, high, "fridge_liner", 0.0, solid=False)
    low, high = (back - 0.002, -inner, CEILING_M), (back + 0.002, inner, FLOOR_M)
    make.span(low, high, "fridge_liner", 0.0, solid=False)
    make.see(shapes.box((0.0, 0.0, CEILING_M + 0.006), (0.20, 0.16, 0.012), "lamp_shade", 0.004))


def _door(
    name: str,
    mass_kg: float,
    span_z: tuple[float, float],
    bar_z: tuple[float, float],
    side: float,
) -> Link:
    """Return a door hinged about the z axis, which extends towards -y times `side`."""
    make = Builder()

    def sheet(x: tuple[float, float], y: tuple[float, float], inset_m: float, *looks: Any) -> None:
        near, far = sorted(side * value for value in y)
        low, high = (x[0], near, span_z[0] + inset_m), (x[1], far, span_z[1] - inset_m)
        make.span(low, high, *looks)

    sheet((0.0085, 0.0615), (-0.691, -0.001), 0.0, "fridge_shell", 0.010)
    sheet((0.001, 0.009), (-0.672, -0.030), 0.02, "gasket", 0.003, False)
    sheet((-0.004, 0.004), (-0.650, -0.052), 0.04, "fridge_liner", 0.002, False)
    low, high = bar_z
    # The bar's centre is the marker (0.10, -0.62, 0.2) of the top door: 38.5 mm of room behind.
    make.bar_handle((0.10, side * -0.62, (low + high) / 2), "z", high - low, 0.0385, "black_metal")
    if name == "top_door":
        plate = (0.062, side * -0.10, -0.48)
        make.see(shapes.box(plate, (0.002, 0.07, 0.016), "black_metal", 0.0005))
    return Link(name, mass_kg, make.parts, make.boxes)


def _receptacles() -> list[Receptacle]:
    floors = {name: top for name, (top, _) in SHELVES_M.items()}
    ceilings = {
        "top": CEILING_M,
        "middle_top": SHELVES_M["top"][1],
        "middle": SHELVES_M["middle_top"][1],
        "middle_bottom": SHELVES_M["middle"][1],
        "bottom": DIVIDER_M[1],
    }
    floors |= {"middle_bottom": DIVIDER_M[0], "bottom": FLOOR_M}
    out = []
    for name in ("bottom", "middle", "middle_bottom", "middle_top", "top"):
        half = (floors[name] - ceilings[name] - 0.006) / 2
        out.append(
            Receptacle(
                f"receptacle_aabb_{name}frl_apartment_refrigerator",
                (-0.0175, 0.0, floors[name] - half),
                (0.2625, 0.294, half),
                up=(0.0, 0.0, -1.0),
                link="body",
            )
        )
    return out
