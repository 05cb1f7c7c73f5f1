"""Books: single ones that lie on their back, and a row that stands."""

import numpy as np

from hab_authoring.apartment import shapes
from hab_authoring.apartment.builder import Builder, finished
from hab_authoring.apartment.model import Box, ObjectModel

COVERS = (
    "label_teal",
    "label_red",
    "label_cream",
    "label_brown",
    "label_blue",
    "label_green",
    "paper",
    "label_orange",
)


def build() -> list[ObjectModel]:
    """Return six templates: number, thickness, width, height, mass, cover, cover print."""
    return [
        _book("01", 0.027, 0.147, 0.205, 0.52, "label_teal", "label_cream"),
        _book("02", 0.052, 0.150, 0.230, 1.15, "label_brown", "brass"),
        _book("03", 0.018, 0.118, 0.180, 0.24, "label_orange", "label_white"),
        _book("04", 0.016, 0.110, 0.175, 0.20, "label_cream", "label_red"),
        _book("05", 0.024, 0.210, 0.250, 0.95, "label_blue", "label_white"),
        _row(),
    ]


def _book(
    number: str, thick: float, width: float, height: float, mass_kg: float, cover: str, ink: str
) -> ObjectModel:
    """Return a book on its back: thickness along y, spine at -x, top of the page at -z."""
    make, board = Builder(), 0.0025
    for y in (board / 2, thick - board / 2):
        make.see(shapes.box((0.0, y, 0.0), (width, board, height), cover, 0.0008))
    make.see(
        shapes.box((-width / 2 + 0.0025, thick / 2, 0.0), (0.005, thick, height), cover, 0.002),
        shapes.box(
            (0.001, thick / 2, 0.0), (width - 0.010, thick - 0.003, height - 0.008), "paper", 0.0
        ),
        shapes.box((0.004, thick, -0.22 * height), (0.66 * width, 0.0008, 0.10 * height), ink, 0.0),
        shapes.box((0.004, thick, -0.08 * height), (0.42 * width, 0.0008, 0.03 * height), ink, 0.0),
        shapes.box((0.004, thick, 0.34 * height), (0.30 * width, 0.0008, 0.03 * height), ink, 0.0),
        shapes.box(
            (-width / 2, thick / 2, -0.1 * height), (0.0008, 0.4 * thick, 0.5 * height), ink, 0.0
        ),
    )
    make.boxes.append(Box((0.0, thick / 2, 0.0), (width, thick, height)))
    return finished(f"book_{number}", "book", mass_kg, make)


def _row() -> ObjectModel:
    """Return a row of books between the boards of a shelf; spines face +z."""
    make, rng, at = Builder(), np.random.default_rng(103), -0.17
    while at < 0.16:
        thick, height = 0.018 + 0.022 * float(rng.random()), 0.17 + 0.055 * float(rng.random())
        depth, cover = 0.13 + 0.03 * float(rng.random()), COVERS[int(rng.integers(len(COVERS)))]
        y, z = -0.11 + height / 2, 0.08 - depth / 2
        make.box((at + thick / 2, y, z), (thick - 0.001, height, depth), cover, 0.002, solid=False)
        make.see(
            shapes.box(
                (at + thick / 2, y + 0.002, z - 0.004),
                (thick - 0.006, height, depth - 0.004),
                "paper",
                0.0,
            )
        )
        make.see(
            shapes.box(
                (at + thick / 2, y + 0.05, 0.0803), (thick - 0.004, 0.012, 0.001), "brass", 0.0
            )
        )
        at += thick
    make.boxes.append(Box((-0.0, 0.0, 0.0), (0.36, 0.22, 0.16)))
    return finished("book_06", "book", 4.8, make)
