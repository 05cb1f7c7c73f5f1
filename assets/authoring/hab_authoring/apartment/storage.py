"""Baskets, bins, boxes, the shoe rack and the closed furniture. Fronts face +z."""

from hab_authoring.apartment import outlines, shapes, solids
from hab_authoring.apartment.builder import Builder, finished, free_box
from hab_authoring.apartment.model import Box, ObjectModel, Receptacle

P = "frl_apartment_"


def build() -> list[ObjectModel]:
    """Return all of them."""
    return [
        _basket(),
        _pedal_bin(),
        _recycling_bin(),
        _hamper(),
        _crate(),
        _shoe_box(),
        _shoe_rack(),
        _low_cabinet(),
        _shoe_cabinet(),
    ]


def _open_box(
    make: Builder,
    size: tuple[float, float, float],
    wall_m: float,
    material: str,
    base_m: float = 0.0,
) -> None:
    """Add a floor and four walls."""
    w, h, d = size
    make.box((0.0, base_m + wall_m / 2, 0.0), (w, wall_m, d), material, 0.003)
    middle, rise = base_m + (h + wall_m) / 2, h - wall_m
    for x in (-(w - wall_m) / 2, (w - wall_m) / 2):
        make.box((x, middle, 0.0), (wall_m, rise, d), material, 0.003)
    for z in (-(d - wall_m) / 2, (d - wall_m) / 2):
        make.box((0.0, middle, z), (w - 2 * wall_m, rise, wall_m), material, 0.003)


def _basket() -> ObjectModel:
    """Return an open wicker basket with two loops."""
    make, (w, h, d) = Builder(), (0.272, 0.24, 0.30)
    _open_box(make, (w, h, d), 0.014, "wicker")
    for y in (0.012, h - 0.008):
        for x in (-w / 2, w / 2):
            make.see(shapes.tube([(x, y, -d / 2), (x, y, d / 2)], 0.008, "wicker", 8))
        for z in (-d / 2, d / 2):
            make.see(shapes.tube([(-w / 2, y, z), (w / 2, y, z)], 0.008, "wicker", 8))
    for side in (-1.0, 1.0):
        loop = [(side * (w / 2 - 0.007), h - 0.01, z) for z in (-0.055, 0.055)]
        top = [(side * (w / 2 - 0.007), h + 0.055, z) for z in (-0.035, 0.035)]
        make.see(shapes.tube([loop[0], top[0], top[1], loop[1]], 0.007, "leather", 8))
        make.boxes.append(Box((side * (w / 2 - 0.007), h + 0.026, 0.0), (0.014, 0.060, 0.09)))
    free = free_box(f"volume{P}basket", (0.0, 0.014, 0.0), (0.115, 0.105, 0.128))
    return finished("basket", "basket", 0.75, make, receptacles=[free])


def _pedal_bin() -> ObjectModel:
    make, w, h, d = Builder(), 0.242, 0.60, 0.33
    outline = outlines.rounded_rectangle(w / 2, d / 2, 0.05, 5)
    make.see(*outlines.extruded(outline, 0.0, 0.04, -0.004, "black_plastic"))
    make.see(*outlines.extruded(outline, 0.04, h - 0.05, 0.0, "steel"))
    make.see(*outlines.extruded(outline, h - 0.05, h - 0.008, -0.003, "black_plastic"))
    make.see(*outlines.extruded(outline, h - 0.008, h, -0.020, "black_plastic"))
    make.box((0.0, 0.018, d / 2 + 0.012), (0.07, 0.012, 0.04), "black_metal", 0.004)
    make.convexes.append(solids.prism(outlines.rounded_rectangle(w / 2, d / 2, 0.05, 3), 0.0, h))
    return finished("bin_01", "bin", 2.4, make)


def _recycling_bin() -> ObjectModel:
    """Return a bin of two closed halves side by side."""
    make, d = Builder(), 0.32
    for x, lid in ((-0.142, "label_blue"), (0.142, "label_green")):
        make.box((x, 0.29, 0.0), (0.272, 0.58, d), "plastic_grey", 0.020)
        make.box((x, 0.62, 0.0), (0.276, 0.08, d + 0.006), lid, 0.020)
        make.see(
            shapes.box((x, 0.50, d / 2), (0.10, 0.028, 0.008), "gap", 0.003),
            shapes.box((x, 0.30, d / 2 + 0.001), (0.12, 0.12, 0.002), "label_white", 0.0),
        )
    return finished("bin_02", "bin", 3.2, make)


def _hamper() -> ObjectModel:
    """Return an open laundry hamper."""
    make, (w, h, d) = Builder(), (0.334, 0.55, 0.42)
    _open_box(make, (w, h, d), 0.012, "linen")
    for y in (0.02, h - 0.015):
        for z in (-d / 2, d / 2):
            make.see(shapes.box((0.0, y, z), (w + 0.008, 0.03, 0.006), "birch", 0.002))
        for x in (-w / 2, w / 2):
            make.see(shapes.box((x, y, 0.0), (0.006, 0.03, d + 0.008), "birch", 0.002))
    free = free_box(f"volume{P}bin_03", (0.0, 0.012, 0.0), (0.145, 0.26, 0.188))
    return finished("bin_03", "bin", 1.6, make, receptacles=[free])


def _crate() -> ObjectModel:
    """Return an open wooden crate with a slot for a hand in either end."""
    make, (w, h, d) = Builder(), (0.343, 0.168, 0.266)
    _open_box(make, (w, h, d), 0.012, "birch")
    for x in (-w / 2, w / 2):
        make.see(shapes.box((x, h - 0.04, 0.0), (0.004, 0.024, 0.09), "gap", 0.001))
    free = free_box(f"volume{P}box", (0.0, 0.012, 0.0), (0.148, 0.075, 0.110))
    return finished("box", "box", 1.3, make, receptacles=[free])


def _shoe_box() -> ObjectModel:
    make = Builder()
    make.box((0.0, 0.046, 0.0), (0.292, 0.092, 0.192), "cardboard", 0.002)
    make.box((0.0, 0.098, 0.0), (0.299, 0.034, 0.199), "label_orange", 0.002)
    make.see(shapes.box((0.0, 0.045, 0.0962), (0.09, 0.045, 0.001), "label_white", 0.0))
    make.see(shapes.box((0.0, 0.1152, 0.0), (0.14, 0.001, 0.05), "label_white", 0.0))
    return finished("shoebox_01", "box", 0.45, make)


def _shoe_rack() -> ObjectModel:
    """Return a rack of three boards."""
    make, w, h, d = Builder(), 0.839, 0.60, 0.313
    for x in (-w / 2 + 0.011, w / 2 - 0.011):
        make.box((x, h / 2, 0.0), (0.022, h, d), "birch", 0.004)
    tops = (0.10, 0.34, h - 0.01)
    for top in tops:
        make.box((0.0, top - 0.009, 0.0), (w - 0.044, 0.018, d - 0.01), "birch", 0.003)
    ceilings = (tops[1] - 0.018, tops[2] - 0.018, tops[2] + 0.28)
    frees: list[Receptacle] = []
    for k, (top, ceiling) in enumerate(zip(tops, ceilings, strict=True)):
        half = (w / 2 - 0.05, (ceiling - top) / 2 - 0.004, d / 2 - 0.03)
        frees.append(free_box(f"Rack1_Top{3 - k}_{P}rack_01", (0.0, top, 0.0), half))
    return finished("rack_01", "rack", 6.5, make, receptacles=frees)


def _low_cabinet() -> ObjectModel:
    """Return a closed low cabinet whose fronts do not move."""
    make, w, h, d = Builder(), 1.589, 0.76, 0.40
    make.box((0.0, 0.035, -0.01), (w - 0.06, 0.07, d - 0.06), "plinth", 0.003)
    make.box((0.0, 0.40, -0.012), (w - 0.02, 0.66, d - 0.05), "white_lacquer", 0.003)
    make.box((0.0, h - 0.015, 0.0), (w, 0.030, d + 0.02), "oak", 0.004)
    for side in (-1.0, 1.0):
        make.box((side * 0.395, 0.40, 0.175), (0.775, 0.645, 0.020), "white_lacquer", 0.003)
        make.see(shapes.box((side * 0.05, 0.40, 0.186), (0.022, 0.16, 0.004), "gap", 0.001))
    free = free_box(f"Cbnt_Top1_{P}cabinet", (0.0, h, 0.0), (w / 2 - 0.05, 0.15, d / 2 - 0.03))
    return finished("cabinet", "cabinet", 36.0, make, receptacles=[free])


def _shoe_cabinet() -> ObjectModel:
    """Return a cabinet of working height: two open shelves over two closed doors."""
    make, w, h, d, t = Builder(), 0.88, 1.26, 0.35, 0.022
    for x in (-w / 2 + t / 2, w / 2 - t / 2):
        make.box((x, h / 2, 0.0), (t, h, d), "oak", 0.003)
    inner, back = w - 2 * t, -d / 2 + 0.006
    make.box((0.0, h / 2 + 0.03, back), (inner, h - 0.06, 0.012), "oak", 0.001)
    make.box((0.0, h - t / 2, 0.006), (inner, t, d - 0.012), "oak", 0.003)
    make.box((0.0, 0.33, 0.0), (inner, 0.58, d - 0.04), "white_lacquer", 0.002)
    for side in (-1.0, 1.0):
        make.see(
            shapes.box(
                (side * inner / 4, 0.33, d / 2 - 0.012),
                (inner / 2 - 0.004, 0.57, 0.018),
                "white_lacquer",
                0.003,
            ),
            shapes.cylinder((side * 0.04, 0.42, d / 2 + 0.004), 0.009, 0.016, "brass", "z", 12),
        )
    tops = (0.642, 0.942)
    for top in tops:
        make.box((0.0, top - t / 2, 0.006), (inner, t, d - 0.012), "oak", 0.003)
    name = f"{P}wall_cabinet_03"
    levels = [(h, h + 0.30), (tops[1], h - t), (tops[0], tops[1] - t)]
    frees = [
        free_box(
            f"WC3_Top{k}_{name}",
            (0.0, top, 0.006),
            (inner / 2 - 0.02, (ceiling - top) / 2 - 0.004, d / 2 - 0.03),
        )
        for k, (top, ceiling) in enumerate(levels, start=1)
    ]
    return finished("wall_cabinet_03", "wall_cabinet", 34.0, make, receptacles=frees)
