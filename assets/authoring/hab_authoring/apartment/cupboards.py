"""Articulated furniture other than the kitchen counter.

Wall cupboards, the room door, the low cabinet with sliding doors, and the chest of six drawers.
"""

import math

from hab_authoring.apartment import shapes
from hab_authoring.apartment.builder import Builder
from hab_authoring.apartment.model import Articulation, Box, Joint, Link, Receptacle

RIGHT_ANGLE_RAD = math.pi / 2
FRONT_M, BACK_M = 0.185, -0.195  # wall cupboard: front and back of the carcass
CUPBOARD_TOP_M = 0.985
SHELVES_M = (0.025, 0.340, 0.580)  # upper faces of bottom, lower and upper shelf
COLUMNS = (
    # Name of the receptacle, walls of the compartment along z, pair of doors.
    ("right", -1.480, -0.638, "doorWindow_2"),
    ("center_right", -0.620, -0.011, "doorWhole_2"),
    ("center_left", 0.007, 0.616, "doorWhole_1"),
    ("left", 0.634, 1.460, "doorWindow_1"),
)


def wall_cupboard() -> Articulation:
    """Return the kitchen's wall cupboards: two pairs of plain doors, two of glass ones."""
    links, joints = [Link("root"), _cupboard_body()], []
    joints.append(Joint("root_rotation", "fixed", "root", "body", rpy=(RIGHT_ANGLE_RAD, 0.0, 0.0)))
    for _, z0, z1, pair in COLUMNS:
        width = (z1 - z0 + 0.018) / 2 - 0.003
        for side, hinge_z, limits in (
            ("L", z1 + 0.0075, (-2.3, 0.0)),
            ("R", z0 - 0.0075, (0.0, 2.3)),
        ):
            sign = -1.0 if side == "L" else 1.0
            name = f"kitchencupboard_{pair}{side}"
            links.append(_cupboard_door(name, sign * width, glass="Window" in pair))
            joints.append(
                Joint(
                    f"{pair}{side}_hinge", "revolute", "body", name,
                    (FRONT_M + 0.026, CUPBOARD_TOP_M / 2, hinge_z), axis=(0.0, 1.0, 0.0),
                    lower=limits[0], upper=limits[1],
                )
            )  # fmt: skip
    return Articulation(
        "kitchenCupboard_01", "kitchenCupboard_01", links, joints, _cupboard_receptacles()
    )


def _cupboard_body() -> Link:
    make = Builder()
    z0, z1, body = -1.498, 1.478, "cabinet_body"
    make.span((BACK_M, 0.004, z0), (FRONT_M, SHELVES_M[0], z1), body, 0.002)
    make.span((BACK_M, CUPBOARD_TOP_M - 0.020, z0), (FRONT_M, CUPBOARD_TOP_M, z1), body, 0.002)
    make.span((BACK_M, SHELVES_M[0], z0), (BACK_M + 0.012, CUPBOARD_TOP_M - 0.02, z1), body, 0.001)
    for z in (-1.489, -0.629, -0.002, 0.625, 1.469):
        make.span(
            (BACK_M + 0.012, SHELVES_M[0], z - 0.009),
            (FRONT_M, CUPBOARD_TOP_M - 0.02, z + 0.009),
            body,
            0.001,
        )
    for _, low, high, _ in COLUMNS:
        for y in SHELVES_M[1:]:
            make.span((BACK_M + 0.012, y - 0.018, low), (FRONT_M - 0.02, y, high), body, 0.001)
    make.span(
        (BACK_M, -0.006, z0), (FRONT_M + 0.018, 0.004, z1), "cabinet_front", 0.002, solid=False
    )
    for z in (z0 - 0.006, z1 + 0.006):
        make.box(
            (-0.005, CUPBOARD_TOP_M / 2, z),
            (0.38, CUPBOARD_TOP_M - 0.002, 0.012),
            "cabinet_front",
            0.002,
        )
    _crockery(make)
    return Link("body", 70.0, make.parts, make.boxes)


def _crockery(make: Builder) -> None:
    """Put plates and cups behind the glass, so that the cupboards look used."""
    for column_z in (-1.06, 1.05):
        for k in range(5):
            y = SHELVES_M[0] + 0.006 + 0.011 * k
            make.see(shapes.cylinder((-0.06, y, column_z - 0.2), 0.10, 0.008, "ceramic", sides=18))
        for k in range(3):
            z = column_z + 0.02 + 0.1 * k
            make.see(
                shapes.cylinder((-0.06, SHELVES_M[1] + 0.045, z), 0.036, 0.09, "ceramic", sides=14)
            )
            make.see(
                shapes.cylinder(
                    (-0.06, SHELVES_M[2] + 0.06, z - 0.15), 0.030, 0.12, "glass", sides=12
                )
            )


def _cupboard_door(name: str, width: float, *, glass: bool) -> Link:
    """Return a door from its hinge to `width`; the sign of `width` is the side."""
    make, low, high, frame = Builder(), -0.484, 0.484, 0.055
    inner, outer = sorted((0.0015 * (1 if width > 0 else -1), width))
    # The axis is at the outer edge, so that an open door stays clear of its neighbour.
    x0, x1 = -0.022, -0.003
    if glass:
        make.span((x0, low, inner), (x1, low + frame, outer), "cabinet_front", 0.003)
        make.span((x0, high - frame, inner), (x1, high, outer), "cabinet_front", 0.003)
        for a, b in ((inner, inner + frame), (outer - frame, outer)):
            make.span((x0, low + frame, a), (x1, high - frame, b), "cabinet_front", 0.003)
        make.span(
            (-0.015, low + frame, inner + frame),
            (-0.011, high - frame, outer - frame),
            "glass",
            0.0,
        )
    else:
        make.span((x0, low, inner), (x1, high, outer), "cabinet_front", 0.003)
    free_edge = width - (0.03 if width > 0 else -0.03)
    make.bar_handle((0.040, -0.31, free_edge), "y", 0.20, 0.043, "brass")
    return Link(name, 3.0, make.parts, make.boxes)


def _cupboard_receptacles() -> list[Receptacle]:
    out = []
    tops = (*(y - 0.018 for y in SHELVES_M[1:]), CUPBOARD_TOP_M - 0.02)
    for column, low, high, _ in COLUMNS:
        for level, floor, ceiling in zip(("bottom", "middle", "top"), SHELVES_M, tops, strict=True):
            prefix, _, side = column.rpartition("_")
            parts = [p for p in (prefix, level, side) if p] if prefix else [side, level]
            half = (ceiling - floor - 0.004) / 2
            out.append(
                Receptacle(
                    f"receptacle_aabb_shelf_{'_'.join(parts)}_kitchenCupboard_01",
                    (-0.0115, floor + half, (low + high) / 2),
                    (0.1615, half, (high - low) / 2 - 0.01),
                    link="body",
                )
            )
    return out


def room_door() -> Articulation:
    """Return the hinged room door; the root is at the top of its hinge."""
    make = Builder()
    make.span((0.008, -2.070, -0.020), (0.915, -0.010, 0.020), "door_paint", 0.003)
    for low, high in ((-1.93, -1.13), (-1.00, -0.14)):
        for face in (-1.0, 1.0):
            make.box(
                (0.46, (low + high) / 2, face * 0.0205),
                (0.62, high - low, 0.006),
                "trim",
                0.002,
                solid=False,
            )
    for face in (-1.0, 1.0):
        rose, lever = (0.845, -1.04, face * 0.026), (0.785, -1.04, face * 0.062)
        make.see(shapes.cylinder(rose, 0.024, 0.012, "brass", "z"))
        make.see(shapes.cylinder((0.845, -1.04, face * 0.045), 0.008, 0.038, "brass", "z", 10))
        make.box(lever, (0.14, 0.016, 0.014), "brass", 0.005)
        make.boxes.append(Box((0.845, -1.04, face * 0.042), (0.02, 0.02, 0.044)))
    hinge = Joint(
        "root_rotation", "revolute", "root", "body", rpy=(0.0, -RIGHT_ANGLE_RAD, 0.0),
        axis=(0.0, 1.0, 0.0), lower=-2.0, upper=0.0,
    )  # fmt: skip
    return Articulation(
        "door2", "door2", [Link("root"), Link("body", 30.0, make.parts, make.boxes)], [hinge]
    )


def sliding_cabinet() -> Articulation:
    """Return the low cabinet; its two doors slide past each other, the front is +z."""
    make = Builder()
    x0, x1, back, front = -0.832, 0.756, -0.218, 0.209
    make.span((x0, 0.730, back), (x1, 0.758, front), "oak", 0.003)
    make.span((x0, 0.165, back), (x1, 0.193, front), "oak", 0.003)
    for a, b in ((x0, x0 + 0.030), (x1 - 0.030, x1), (-0.090, 0.014)):
        depth = front if a != -0.090 else 0.155
        make.span((a, 0.193, back), (b, 0.730, depth), "oak", 0.003)
    make.span((x0 + 0.03, 0.193, back), (x1 - 0.03, 0.730, back + 0.012), "oak", 0.001)
    for x in (x0 + 0.06, x1 - 0.06):
        for z in (back + 0.05, front - 0.05):
            make.span(
                (x - 0.018, -0.05, z - 0.018), (x + 0.018, 0.165, z + 0.018), "black_metal", 0.003
            )
    doors = [_sliding_door("left_door"), _sliding_door("right_door")]
    joints = [
        Joint("body_transform", "fixed", "root", "body"),
        Joint("left_slide", "prismatic", "body", "left_door", (-0.4385, 0.4615, 0.172),
              upper=0.8, velocity=1.0),
        Joint("right_slide", "prismatic", "body", "right_door", (0.3625, 0.4615, 0.196),
              lower=-0.76, upper=0.0, velocity=1.0),
    ]  # fmt: skip
    body = Link("body", 25.0, make.parts, make.boxes)
    return Articulation("cabinet", "cabinet", [Link("root"), body, *doors], joints)


def _sliding_door(name: str) -> Link:
    """Return a slatted door; only the front one can have a bar, as it passes the other."""
    make = Builder()
    make.box((0.0, 0.0, 0.0), (0.722, 0.530, 0.016), "oak", 0.002)
    for k in range(12):
        make.box((-0.33 + 0.06 * k, 0.0, 0.0085), (0.044, 0.500, 0.003), "oak", 0.001, solid=False)
    if name == "left_door":
        make.box((-0.325, 0.0, 0.0095), (0.026, 0.18, 0.004), "brass", 0.001, solid=False)
        return Link(name, 2.0, make.parts, make.boxes)
    make.see(shapes.cylinder((0.32, 0.0, 0.050), 0.007, 0.20, "brass", "y", 12))
    make.boxes.append(Box((0.32, 0.0, 0.050), (0.014, 0.20, 0.014)))
    for y in (-0.08, 0.08):
        make.see(shapes.cylinder((0.32, y, 0.029), 0.005, 0.042, "brass", "z", 10))
        make.boxes.append(Box((0.32, y, 0.029), (0.010, 0.010, 0.042)))
    return Link(name, 2.0, make.parts, make.boxes)


CHEST_ROWS = (("top", 1.075, 1.215), ("mid", 0.655, 1.067), ("bot", 0.125, 0.647))


def drawer_chest() -> Articulation:
    """Return the chest of six drawers, two to a row; +x is the front."""
    links, joints = [Link("root"), _chest_body()], []
    joints.append(Joint("root_rotation", "fixed", "root", "body", rpy=(RIGHT_ANGLE_RAD, 0.0, 0.0)))
    for row, low, high in CHEST_ROWS:
        for side, z in (("L", 0.2095), ("R", -0.2095)):
            name = f"drawer_{row}{side}"
            links.append(_chest_drawer(name, high - low))
            joints.append(Joint(name, "prismatic", "body", name, (-0.105, low, z), upper=0.2))
    return Articulation("chestOfDrawers_01", "chestOfDrawers_01", links, joints)


def _chest_body() -> Link:
    make = Builder()
    back, front, half = -0.150, 0.140, 0.436
    make.span((back, 1.230, -half), (front + 0.03, 1.255, half), "walnut", 0.004)
    make.span((back, 0.100, -half + 0.018), (front, 0.118, half - 0.018), "walnut", 0.002)
    make.span((back, 0.118, -half + 0.018), (back + 0.012, 1.230, half - 0.018), "walnut", 0.001)
    for z in (-half + 0.009, half - 0.009):
        make.span((back, 0.100, z - 0.009), (front, 1.230, z + 0.009), "walnut", 0.002)
    make.span((back + 0.012, 0.118, -0.006), (front - 0.004, 1.230, 0.006), "walnut", 0.001)
    for x in (back + 0.03, front - 0.03):
        for z in (-half + 0.03, half - 0.03):
            make.span((x - 0.018, 0.0, z - 0.018), (x + 0.018, 0.100, z + 0.018), "walnut", 0.004)
    return Link("body", 30.0, make.parts, make.boxes)


def _chest_drawer(name: str, height_m: float) -> Link:
    """Return a drawer whose frame is at the inside back of its floor."""
    make, half, front = Builder(), 0.190, 0.252
    top = height_m - 0.03
    make.span((0.0, 0.004, -half), (front, 0.014, half), "birch", 0.001)
    make.span((0.0, 0.014, -half), (0.010, top, half), "birch", 0.001)
    for z in (-half + 0.005, half - 0.005):
        make.span((0.010, 0.014, z - 0.005), (front, top, z + 0.005), "birch", 0.001)
    make.span((front, 0.0, -0.2045), (front + 0.018, height_m, 0.2045), "walnut", 0.003)
    make.bar_handle((front + 0.056, height_m * 0.6, 0.0), "z", 0.14, 0.038, "brass")
    return Link(name, 2.5, make.parts, make.boxes)
