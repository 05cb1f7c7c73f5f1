"""The kitchen counter: seven drawers, a sink with its tap, and the worktop.

The link frames are y-up with +x out of the drawers and +z along the counter.
"""

from dataclasses import dataclass

from hab_authoring.apartment import shapes
from hab_authoring.apartment.builder import Builder
from hab_authoring.apartment.model import Articulation, Joint, Link, Receptacle

FLOOR_M = -0.030  # the root stands this much above the floor
TOP_M, WORKTOP_M = 0.846, 0.038
BACK_M, EDGE_M, CARCASS_M = -0.500, 0.125, 0.075
SINK_X, SINK_Z, SINK_FLOOR_M = (-0.30, -0.02), (0.11, 0.53), 0.690
FACE_M, BAR_M = 0.261, 0.300  # drawer frame: outside of the front, centre of the bar
BOARD_M = 0.015


@dataclass(frozen=True)
class Drawer:
    """One drawer: position of its frame, extent of its front and depth of its box."""

    link: str
    joint: str
    receptacle: str
    mass_kg: float
    y_m: float
    z_m: float
    front_y: tuple[float, float]
    half_front_m: float
    half_box_m: float
    bottom_m: float
    side_top_m: float
    half_height_m: float


DRAWERS = (
    Drawer(
        "drawer1_top",
        "left_slide_top",
        "left_top",
        5.0,
        0.600,
        1.0705,
        (-0.176, 0.172),
        0.4515,
        0.425,
        -0.150,
        0.090,
        0.138,
    ),
    Drawer(
        "drawer1_bottom",
        "left_slide_bottom",
        "left_bottom",
        5.0,
        0.232,
        1.0705,
        (-0.162, 0.188),
        0.4515,
        0.425,
        -0.150,
        0.090,
        0.138,
    ),
    Drawer(
        "drawer2_top",
        "middle_slide_top",
        "middle_top",
        4.0,
        0.664,
        -0.28605,
        (-0.121, 0.108),
        0.298,
        0.275,
        -0.098,
        0.050,
        0.071,
    ),
    Drawer(
        "drawer2_middle",
        "middle_slide_middle",
        "middle_middle",
        4.0,
        0.420,
        -0.28605,
        (-0.114, 0.119),
        0.298,
        0.275,
        -0.098,
        0.050,
        0.071,
    ),
    Drawer(
        "drawer2_bottom",
        "middle_slide_bottom",
        "middle_bottom",
        4.0,
        0.180,
        -0.28605,
        (-0.110, 0.122),
        0.298,
        0.275,
        -0.098,
        0.050,
        0.071,
    ),
    Drawer(
        "drawer3",
        "right_slide_top",
        "right_top",
        4.0,
        0.530,
        -1.0264,
        (-0.093, 0.102),
        0.437,
        0.410,
        -0.085,
        0.045,
        0.083,
    ),
    Drawer(
        "drawer4",
        "right_slide_bottom",
        "right_bottom",
        6.0,
        0.236,
        -1.0264,
        (-0.166, 0.197),
        0.437,
        0.410,
        -0.150,
        0.090,
        0.131,
    ),
)
FRAME_X_M = -0.160


def build() -> Articulation:
    """Return the kitchen counter."""
    links = [Link("root"), _body()]
    joints = [Joint("body_transform", "fixed", "root", "body")]
    for drawer in DRAWERS:
        links.append(_drawer(drawer))
        place = (FRAME_X_M, drawer.y_m, drawer.z_m)
        joints.append(
            Joint(drawer.joint, "prismatic", "body", drawer.link, place, upper=0.5, velocity=1.0)
        )
    return Articulation("kitchen_counter", "kitchen_counter", links, joints, _receptacles())


def _body() -> Link:
    make = Builder()
    _carcass(make)
    _worktop(make)
    _sink(make)
    return Link("body", 120.0, make.parts, make.boxes)


def _carcass(make: Builder) -> None:
    low, high, front = 0.040, TOP_M - WORKTOP_M, CARCASS_M
    make.span((BACK_M + 0.01, FLOOR_M, -1.49), (front - 0.05, low, 1.54), "plinth", 0.002)
    make.span((BACK_M, low, -1.502), (front, low + 0.018, 1.552), "cabinet_body", 0.002)
    make.span((BACK_M, low + 0.018, -1.475), (BACK_M + 0.012, high, 1.5245), "cabinet_body", 0.001)
    for z in (-1.4885, 1.538):
        make.span(
            (BACK_M, low, z - 0.0135), (front + 0.026, high, z + 0.0135), "cabinet_front", 0.002
        )
    for z in (-0.5885, 0.0165, 0.600):
        make.span(
            (BACK_M + 0.012, low + 0.018, z - 0.0075),
            (front, high, z + 0.0075),
            "cabinet_body",
            0.001,
        )
    # Fixed fronts: the block above the right-hand drawers, and the doors under the sink.
    make.span((0.0, 0.652, -1.475), (front, high, -0.596), "cabinet_body", 0.001)
    make.span(
        (front + 0.007, 0.638, -1.4634), (front + 0.026, 0.772, -0.5894), "cabinet_front", 0.003
    )
    for z0, z1 in ((0.0215, 0.3165), (0.3205, 0.6155)):
        make.span((front + 0.007, 0.070, z0), (front + 0.026, 0.772, z1), "cabinet_front", 0.003)
    make.span((front - 0.02, low + 0.018, 0.024), (front + 0.007, high, 0.592), "gap", 0.0)
    make.see(shapes.box((front + 0.0265, 0.705, -1.026), (0.002, 0.05, 0.30), "screen", 0.0005))


def _worktop(make: Builder) -> None:
    low, z0, z1 = TOP_M - WORKTOP_M, -1.527, 1.581
    pieces = (
        ((BACK_M, z0), (EDGE_M, SINK_Z[0])),
        ((BACK_M, SINK_Z[1]), (EDGE_M, z1)),
        ((SINK_X[1], SINK_Z[0]), (EDGE_M, SINK_Z[1])),
        ((BACK_M, SINK_Z[0]), (SINK_X[0], SINK_Z[1])),
    )
    for (x0, a), (x1, b) in pieces:
        make.span((x0, low, a), (x1, TOP_M, b), "worktop", 0.0015)
    make.span((BACK_M - 0.004, TOP_M, z0), (BACK_M + 0.012, TOP_M + 0.05, z1), "worktop", 0.003)


def _sink(make: Builder) -> None:
    (x0, x1), (z0, z1) = SINK_X, SINK_Z
    wall, low = 0.006, TOP_M - WORKTOP_M
    make.span(
        (x0 - wall, SINK_FLOOR_M - 0.012, z0 - wall),
        (x1 + wall, SINK_FLOOR_M, z1 + wall),
        "steel",
        0.002,
    )
    for a, b in (
        ((x0 - wall, z0), (x0, z1)),
        ((x1, z0), (x1 + wall, z1)),
        ((x0 - wall, z0 - wall), (x1 + wall, z0)),
        ((x0 - wall, z1), (x1 + wall, z1 + wall)),
    ):
        make.span((a[0], SINK_FLOOR_M, a[1]), (b[0], low, b[1]), "steel", 0.001)
    rim = TOP_M + 0.0015
    for a, b in (
        ((x0 - 0.02, z0 - 0.02), (x0 + 0.004, z1 + 0.02)),
        ((x1 - 0.004, z0 - 0.02), (x1 + 0.02, z1 + 0.02)),
        ((x0, z0 - 0.02), (x1, z0 + 0.004)),
        ((x0, z1 - 0.004), (x1, z1 + 0.02)),
    ):
        make.span((a[0], low, a[1]), (b[0], rim, b[1]), "steel", 0.001, solid=False)
    middle = ((x0 + x1) / 2, (z0 + z1) / 2)
    make.see(
        shapes.cylinder((middle[0], SINK_FLOOR_M + 0.002, middle[1]), 0.035, 0.005, "black_metal")
    )
    _tap(make, x0 - 0.06, middle[1])


def _tap(make: Builder, x: float, z: float) -> None:
    arch = [
        (x, TOP_M, z),
        (x, TOP_M + 0.20, z),
        (x + 0.01, TOP_M + 0.235, z),
        (x + 0.035, TOP_M + 0.262, z),
        (x + 0.07, TOP_M + 0.270, z),
        (x + 0.105, TOP_M + 0.262, z),
        (x + 0.13, TOP_M + 0.235, z),
        (x + 0.137, TOP_M + 0.19, z),
    ]
    make.see(shapes.tube(arch, 0.011, "steel", 12))
    make.see(shapes.cylinder((x, TOP_M + 0.02, z), 0.024, 0.04, "steel"))
    make.see(
        shapes.tube(
            [(x, TOP_M + 0.06, z), (x, TOP_M + 0.07, z + 0.05), (x, TOP_M + 0.075, z + 0.07)],
            0.006,
            "steel",
        )
    )
    solid = Builder()
    solid.span((x - 0.02, TOP_M, z - 0.02), (x + 0.02, TOP_M + 0.262, z + 0.02), "steel")
    solid.span((x + 0.02, TOP_M + 0.225, z - 0.012), (x + 0.15, TOP_M + 0.281, z + 0.012), "steel")
    make.boxes.extend(solid.boxes)


def _drawer(drawer: Drawer) -> Link:
    make, w = Builder(), drawer.half_box_m
    back, front = -0.310, FACE_M - 0.019
    floor, top = drawer.bottom_m, drawer.side_top_m
    make.span((back, floor, -w), (front, floor + 0.016, w), "birch", 0.001)
    make.span((back, floor + 0.016, -w), (back + BOARD_M, top, w), "birch", 0.002)
    for side in (-1.0, 1.0):
        z0, z1 = sorted((side * w, side * (w - BOARD_M)))
        make.span((back + BOARD_M, floor + 0.016, z0), (front, top, z1), "birch", 0.002)
    f = drawer.half_front_m
    make.span(
        (front, drawer.front_y[0], -f), (FACE_M, drawer.front_y[1], f), "cabinet_front", 0.003
    )
    make.bar_handle((BAR_M, 0.0, 0.0), "z", min(0.32, 1.1 * f), BAR_M - FACE_M, "brass")
    return Link(drawer.link, drawer.mass_kg, make.parts, make.boxes)


def _receptacles() -> list[Receptacle]:
    tail, half_top = "kitchen_counter", 0.19125
    out = [
        Receptacle(
            f"receptacle_aabb_counter_left_{tail}",
            (-0.185, TOP_M + half_top, 1.0976),
            (0.295, half_top, 0.45152),
            link="body",
        ),
        Receptacle(
            f"receptacle_aabb_counter_right_{tail}",
            (-0.185, TOP_M + half_top, -0.7387),
            (0.295, half_top, 0.7560),
            link="body",
        ),
        Receptacle(
            f"receptacle_aabb_sink_{tail}",
            (-0.16, SINK_FLOOR_M + 0.098, 0.32),
            (0.1118, 0.098, 0.1806),
            link="body",
        ),
    ]
    for drawer in DRAWERS:
        floor = drawer.bottom_m + 0.016
        x0, x1 = -0.310 + BOARD_M + 0.005, FACE_M - 0.019 - 0.005
        half = ((x1 - x0) / 2, drawer.half_height_m, drawer.half_box_m - BOARD_M - 0.005)
        center = ((x0 + x1) / 2, floor + drawer.half_height_m, 0.0)
        name = f"receptacle_aabb_drawer_{drawer.receptacle}_frl_apartment_{tail}"
        out.append(Receptacle(name, center, half, link=drawer.link))
    return out
