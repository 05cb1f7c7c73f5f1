"""Tables, the television bench and the open shelves."""

from hab_authoring.apartment import shapes
from hab_authoring.apartment.builder import Builder
from hab_authoring.apartment.model import ObjectModel, Part, Receptacle


def build() -> list[ObjectModel]:
    """Return all tables and shelves."""
    return [
        _dining_table(),
        _console(),
        _coffee_table(),
        _side_table(),
        _tv_bench(),
        _shelf("01", "birch", 0.236, 1.037, 0.924, 0.186, 11.0),
        _shelf("02", "oak", 0.465, 1.066, 0.916, 0.188, 19.0),
    ]


def _free(
    name: str, center: tuple[float, float, float], half: tuple[float, float, float]
) -> Receptacle:
    """Return a receptacle from the centre of its bottom face."""
    return Receptacle(f"receptacle_aabb_{name}", (center[0], center[1] + half[1], center[2]), half)


def _dining_table() -> ObjectModel:
    make, top, floor, wood = Builder(), 0.0986, -0.664, "oak"
    make.soft((0.0, top - 0.016, 0.0), (1.40, 0.032, 0.852), wood, 0.010)
    for z in (-0.33, 0.33):
        make.box((0.0, top - 0.067, z), (1.18, 0.07, 0.022), wood)
    for x in (-0.60, 0.60):
        make.box((x, top - 0.067, 0.0), (0.022, 0.07, 0.66), wood)
        for z in (-0.345, 0.345):
            make.box(
                (x, (floor + top - 0.032) / 2, z), (0.06, top - 0.032 - floor, 0.06), wood, 0.008
            )
    free = _free("Tbl1_Top1_frl_apartment_table_01", (0.0, top, 0.0), (0.68, 0.0946, 0.41))
    return ObjectModel("frl_apartment_table_01", "table", 18.0, make.parts, make.solids(), [free])


def _console() -> ObjectModel:
    """Return the dark console: a deep top at working height, two shelves underneath."""
    make, top, floor, wood = Builder(), 0.332, -0.592, "walnut"
    back, front = 0.448, -0.360
    make.soft((0.0, top - 0.02, (back + front) / 2), (1.282, 0.04, back - front), wood, 0.008)
    for x in (-0.60, 0.60):
        for z in (front + 0.05, back - 0.05):
            make.box(
                (x, (floor + top - 0.04) / 2, z), (0.06, top - 0.04 - floor, 0.06), wood, 0.006
            )
    for z in (front + 0.05, back - 0.05):
        make.box((0.0, top - 0.08, z), (1.14, 0.08, 0.022), wood)
    levels = {"Tbl2_Top2": -0.0457, "Tbl2_Top3": -0.378}
    for level in levels.values():
        make.box((0.0, level - 0.0125, 0.04), (1.26, 0.025, 0.72), wood)
    tail = "_frl_apartment_table_02"
    frees = [_free(f"Tbl2_Top1{tail}", (0.0, top, 0.044), (0.62, 0.1366, 0.39))]
    frees += [
        _free(name + tail, (0.0, level, 0.04), (0.55, 0.1366, 0.33))
        for name, level in levels.items()
    ]
    return ObjectModel("frl_apartment_table_02", "table", 24.0, make.parts, make.solids(), frees)


def _coffee_table() -> ObjectModel:
    make, top, floor = Builder(), 0.0857, -0.330
    make.soft((0.0, top - 0.015, 0.0), (1.208, 0.030, 0.710), "birch", 0.010)
    make.box((0.0, floor + 0.13, 0.0), (1.02, 0.018, 0.54), "birch")
    for x in (-0.53, 0.53):
        for z in (-0.29, 0.29):
            make.post((x, (floor + top - 0.030) / 2, z), 0.018, top - 0.030 - floor, "black_metal")
    make.see(*_magazines(floor + 0.139))
    free = _free("Tbl3_Top1_frl_apartment_table_03", (0.0, top, 0.0), (0.59, 0.1731, 0.34))
    return ObjectModel("frl_apartment_table_03", "table", 22.0, make.parts, make.solids(), [free])


def _magazines(level: float) -> list[Part]:
    return [
        shapes.rotated(
            shapes.box(
                (0.2, level + 0.006 + 0.009 * k, 0.02), (0.21, 0.008, 0.28), material, 0.001
            ),
            "y",
            0.2 - 0.13 * k,
        )
        for k, material in enumerate(("paper", "label_teal", "label_cream"))
    ]


def _side_table() -> ObjectModel:
    make, top, floor = Builder(), 0.066, -0.425
    make.soft((0.0, top - 0.012, 0.0), (0.47, 0.024, 0.47), "birch", 0.009)
    for x in (-0.19, 0.19):
        for z in (-0.19, 0.19):
            make.post((x, (floor + top - 0.024) / 2, z), 0.016, top - 0.024 - floor, "birch")
    make.box((0.0, -0.22, 0.0), (0.38, 0.016, 0.38), "birch")
    return ObjectModel("frl_apartment_table_04", "table", 3.1, make.parts, make.solids())


def _tv_bench() -> ObjectModel:
    """Return the bench: drawers' fronts on both sides, two open bays in the middle."""
    make, top, floor, wood = Builder(), 0.250, -0.377, "oak"
    back, front = 0.218, -0.286
    depth, middle = back - front, (back + front) / 2
    make.box((0.0, top - 0.015, middle), (1.516, 0.030, depth), wood)
    make.box((0.0, -0.2295, middle), (1.516, 0.028, depth), wood)
    make.box((0.0, 0.0, back - 0.008), (1.48, 0.43, 0.016), wood, 0.001)
    for x in (-0.745, -0.243, 0.243, 0.745):
        make.box((x, 0.002, middle - 0.006), (0.026, 0.435, depth - 0.016), wood, 0.002)
    make.box((0.0, 0.0816, middle - 0.006), (0.46, 0.020, depth - 0.020), wood, 0.002)
    for side in (-1.0, 1.0):
        for y, height in ((0.112, 0.206), (-0.106, 0.216)):
            make.box(
                (side * 0.494, y, front + 0.010), (0.472, height, 0.018), "white_lacquer", 0.003
            )
            make.see(
                shapes.cylinder(
                    (side * 0.494, y + 0.05, front - 0.008), 0.010, 0.020, "brass", "z", 12
                )
            )
        make.box((side * 0.494, 0.0, middle), (0.46, 0.42, depth - 0.06), "gap", 0.0)
        for z in (front + 0.06, back - 0.06):
            make.post((side * 0.66, (floor - 0.2435) / 2, z), 0.020, -0.2435 - floor, "black_metal")
    tail = "_frl_apartment_tvstand"
    frees = [
        _free(f"TvStnd1_Top1{tail}", (0.0, top, -0.034), (0.74, 0.0914, 0.24)),
        _free(f"TvStnd1_Top2{tail}", (0.0, 0.0916, -0.04), (0.215, 0.060, 0.215)),
        _free(f"TvStnd1_Top3{tail}", (0.0, -0.2155, -0.04), (0.215, 0.1395, 0.215)),
    ]
    return ObjectModel("frl_apartment_tvstand", "tv_stand", 29.0, make.parts, make.solids(), frees)


def _shelf(
    number: str, wood: str, half_x: float, down: float, up: float, half_z: float, mass_kg: float
) -> ObjectModel:
    """Return a tall open shelf; the front is +z, the origin about half-way up."""
    make, board = Builder(), 0.022
    tops = [-down + 0.105 + k * (up - 0.25 + down - 0.105) / 5 for k in range(6)]
    for x in (-half_x + board / 2, half_x - board / 2):
        make.box((x, (up - down) / 2, 0.0), (board, up + down, 2 * half_z), wood, 0.003)
    inner = half_x - board
    make.box((0.0, up - board / 2, 0.0), (2 * inner, board, 2 * half_z), wood, 0.003)
    make.box(
        (0.0, (up - down) / 2 + 0.04, -half_z + 0.005),
        (2 * inner, up + down - 0.10, 0.010),
        wood,
        0.001,
    )
    for top in tops:
        make.box((0.0, top - board / 2, 0.006), (2 * inner, board, 2 * half_z - 0.012), wood, 0.003)
    make.box(
        (0.0, -down + 0.035, half_z - 0.03), (2 * inner, 0.07, 0.016), wood, 0.002, solid=False
    )
    name = f"frl_apartment_wall_cabinet_{number}"
    ceilings = [*(top - board for top in tops[1:]), up - board]
    frees = []
    for index, (top, ceiling) in enumerate(
        zip(reversed(tops), reversed(ceilings), strict=True), start=1
    ):
        half = ((inner - 0.01), (ceiling - top) / 2 - 0.003, half_z - 0.02)
        joint = "" if number == "01" else "_"
        frees.append(_free(f"WC{int(number)}_Top{index}{joint}{name}", (0.0, top, 0.008), half))
    return ObjectModel(name, "wall_cabinet", mass_kg, make.parts, make.solids(), frees)
