"""Coffee machine, kettle, refrigerator, and the small electronics of the flat. Fronts face +z."""

import math

from hab_authoring.apartment import outlines, shapes, solids
from hab_authoring.apartment.builder import Builder, finished
from hab_authoring.apartment.model import Box, ObjectModel


def build() -> list[ObjectModel]:
    """Return all of them."""
    return [
        _coffee_machine(),
        _kettle(),
        _refrigerator(),
        _monitor(),
        _monitor_riser(),
        _set_top_box(),
        _console(),
        _camera(),
        _remote(),
    ]


def _coffee_machine() -> ObjectModel:
    make, w = Builder(), 0.20
    make.span((-w / 2, 0.0, -0.15), (w / 2, 0.035, 0.16), "black_plastic", 0.006)
    make.span((-w / 2, 0.035, -0.15), (w / 2, 0.25, -0.01), "steel", 0.008)
    make.span((-w / 2, 0.25, -0.15), (w / 2, 0.345, 0.12), "steel", 0.010)
    make.see(
        shapes.box((0.0, 0.037, 0.09), (0.17, 0.006, 0.12), "gap", 0.001),
        shapes.box((0.0, 0.31, 0.121), (0.13, 0.035, 0.004), "screen", 0.001),
        shapes.cylinder((0.0, 0.235, 0.06), 0.028, 0.05, "black_plastic", sides=18),
        shapes.box((0.0, 0.225, 0.115), (0.022, 0.018, 0.09), "black_plastic", 0.004),
        shapes.cylinder((w / 2 + 0.004, 0.20, 0.03), 0.018, 0.012, "black_plastic", "x", 14),
    )
    for x in (-0.04, 0.0, 0.04):
        make.see(shapes.cylinder((x, 0.27, 0.122), 0.008, 0.006, "label_white", "z", 12, 0.001))
    make.boxes.append(Box((0.0, 0.23, 0.075), (0.06, 0.05, 0.16)))
    return finished("small_appliance_01", "small_appliance", 6.2, make)


def _kettle() -> ObjectModel:
    """Return an electric kettle on its base, its handle towards -z."""
    make = Builder()
    base = [(0.078, 0.0), (0.080, 0.008), (0.076, 0.020)]
    body = [(0.076, 0.022), (0.079, 0.030), (0.073, 0.10), (0.058, 0.175), (0.050, 0.200)]
    lid = [(0.050, 0.200), (0.046, 0.208), (0.012, 0.214), (0.0, 0.214)]
    make.see(
        shapes.lathe([[(0.0, 0.0), base[0]], base, [base[-1], (0.0, 0.020)]], "black_plastic", 24),
        shapes.lathe([[(0.0, 0.022), body[0]], body], "steel", 24),
        shapes.lathe([lid], "black_plastic", 24),
        shapes.cylinder((0.0, 0.222, 0.0), 0.012, 0.018, "black_plastic", sides=12),
        shapes.tube(
            [(0.0, 0.165, 0.048), (0.0, 0.185, 0.072), (0.0, 0.196, 0.084)], 0.013, "steel", 8
        ),
    )
    loop = [
        (0.0, 0.185, -0.05),
        (0.0, 0.20, -0.085),
        (0.0, 0.18, -0.115),
        (0.0, 0.10, -0.118),
        (0.0, 0.05, -0.075),
    ]
    make.see(shapes.tube(outlines.bent(loop, 11), 0.011, "black_plastic", 8))
    make.convexes += [
        solids.frustum(0.080, 0.079, 0.0, 0.030),
        solids.frustum(0.079, 0.052, 0.030, 0.200),
        solids.frustum(0.050, 0.012, 0.200, 0.231, 12),
    ]
    make.boxes.append(Box((0.0, 0.12, -0.100), (0.022, 0.17, 0.056)))
    make.boxes.append(Box((0.0, 0.183, 0.070), (0.024, 0.034, 0.040)))
    return finished("small_appliance_02", "small_appliance", 1.3, make)


def _refrigerator() -> ObjectModel:
    """Return a closed refrigerator whose doors do not move."""
    make, w, h, d = Builder(), 0.697, 1.90, 0.70
    make.box((0.0, 0.03, -0.02), (w - 0.04, 0.06, d - 0.10), "plinth", 0.004)
    make.box((0.0, 0.06 + (h - 0.06) / 2, -0.04), (w, h - 0.06, d - 0.08), "fridge_shell", 0.006)
    for low, high in ((0.07, 0.70), (0.71, h)):
        make.span((-w / 2, low, 0.275), (w / 2, high, 0.345), "fridge_shell", 0.010)
    for low, high in ((0.50, 0.66), (0.76, 1.20)):
        place = (-w / 2 + 0.06, (low + high) / 2, 0.365)
        make.box(place, (0.022, high - low, 0.040), "black_metal", 0.006)
    return finished("refrigerator", "refrigerator", 78.0, make)


def _monitor() -> ObjectModel:
    """Return a screen on its own foot."""
    make = Builder()
    make.box((0.0, 0.006, 0.0), (0.26, 0.012, 0.20), "black_metal", 0.004)
    make.box((0.0, 0.11, -0.045), (0.06, 0.20, 0.018), "black_metal", 0.004)
    make.box((0.0, 0.305, -0.010), (0.615, 0.365, 0.030), "black_plastic", 0.006)
    make.see(shapes.box((0.0, 0.309, 0.0055), (0.598, 0.340, 0.002), "screen", 0.0005))
    make.box((0.0, 0.27, -0.040), (0.24, 0.18, 0.032), "black_plastic", 0.010)
    return finished("monitor", "monitor", 5.4, make)


def _monitor_riser() -> ObjectModel:
    """Return a low bench that lifts a screen off a desk."""
    make = Builder()
    make.box((0.0, 0.111, 0.0), (0.577, 0.018, 0.24), "birch", 0.004)
    for x in (-0.27, 0.27):
        make.box((x, 0.051, 0.0), (0.018, 0.102, 0.22), "birch", 0.003)
    make.box((0.0, 0.075, -0.10), (0.522, 0.05, 0.012), "birch", 0.002)
    return finished("monitor_stand", "monitor", 1.9, make)


def _set_top_box() -> ObjectModel:
    make = Builder()
    make.box((0.0, 0.017, 0.0), (0.166, 0.030, 0.130), "black_plastic", 0.006)
    make.see(
        shapes.box((0.02, 0.017, 0.0652), (0.09, 0.014, 0.001), "screen", 0.0),
        shapes.cylinder((-0.06, 0.017, 0.0655), 0.005, 0.002, "steel", "z", 12, 0.0005),
        shapes.box((0.0, 0.002, 0.0), (0.14, 0.004, 0.105), "gap", 0.0),
    )
    make.boxes.append(Box((0.0, 0.001, 0.0), (0.14, 0.002, 0.105)))
    return finished("setupbox", "tablet", 0.42, make)


def _console() -> ObjectModel:
    """Return a game console lying flat."""
    make = Builder()
    make.box((0.0, 0.014, 0.0), (0.256, 0.028, 0.189), "plastic_white", 0.006)
    make.box((0.0, 0.029, -0.004), (0.248, 0.006, 0.175), "black_plastic", 0.0)
    make.box((0.0, 0.045, 0.0), (0.256, 0.028, 0.189), "plastic_white", 0.006)
    make.see(
        shapes.box((-0.05, 0.014, 0.0948), (0.10, 0.004, 0.001), "gap", 0.0),
        shapes.cylinder((0.10, 0.045, 0.0950), 0.006, 0.002, "label_teal", "z", 12, 0.0005),
    )
    return finished("tv_object", "tablet", 1.6, make)


def _camera() -> ObjectModel:
    make = Builder()
    make.box((0.0, 0.042, 0.0), (0.135, 0.084, 0.060), "black_plastic", 0.010)
    make.box((0.0, 0.092, -0.005), (0.056, 0.028, 0.050), "black_plastic", 0.008)
    make.box((-0.052, 0.042, 0.020), (0.030, 0.080, 0.050), "black_plastic", 0.010)
    make.see(
        shapes.cylinder((0.010, 0.042, 0.065), 0.036, 0.075, "black_metal", "z", 22, 0.003),
        shapes.cylinder((0.010, 0.042, 0.088), 0.038, 0.018, "black_plastic", "z", 22, 0.002),
        shapes.cylinder((0.010, 0.042, 0.1025), 0.029, 0.002, "screen", "z", 22, 0.0005),
        shapes.cylinder((0.048, 0.088, 0.0), 0.010, 0.010, "steel", sides=14),
        shapes.box((0.0, 0.045, -0.031), (0.085, 0.055, 0.002), "screen", 0.0005),
    )
    lens = solids.rotated(solids.frustum(0.038, 0.038, 0.03, 0.1035, 12), "x", math.pi / 2)
    make.convexes.append(solids.moved(lens, (0.010, 0.042, 0.0)))
    return finished("camera_02", "camera", 0.85, make)


def _remote() -> ObjectModel:
    make = Builder()
    make.box((0.0, 0.009, 0.0), (0.047, 0.018, 0.177), "black_plastic", 0.005)
    for row in range(5):
        for column in (-1, 0, 1):
            place = (0.013 * column, 0.0185, 0.045 - 0.018 * row)
            make.see(shapes.box(place, (0.008, 0.002, 0.009), "plastic_grey", 0.0))
    make.see(
        shapes.cylinder((0.0, 0.0185, -0.062), 0.015, 0.002, "plastic_grey", bevel_m=0.0005),
        shapes.cylinder((0.013, 0.0185, 0.072), 0.005, 0.002, "label_red", sides=12, bevel_m=0.0),
    )
    return finished("remote-control_01", "remote_control", 0.11, make)
