"""Usable receptacles, sampled points on them, and settling of objects there."""

import math

import numpy as np
import pytest
import start_checks as sc
from builders import box_glb, tiny_dataset, tiny_scene, write_json, write_scene

from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.spots import find_spots, receptacles_named, spot_of, unusable, widest
from hab_tasks.world.scenes.habitat.dataset import SceneDataset, resolve_dataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.objects import load_objects

TEMPLATES = load_objects(None)
SCENE = "v3_sc0_staging_00"
BOX = "003_cracker_box_:0000"
INSIDE = "receptacle_aabb_drawer"


@pytest.fixture
def tiny(tmp_path):
    """The tiny dataset with a receptacle on the chest's drawer, and a table with nothing on it."""
    root = tiny_dataset(tmp_path / "tiny")
    entry = {"name": INSIDE, "parent_link": "drawer", "position": [0.3, 0.09, 0.0]}
    config = {"user_defined": {INSIDE: entry | {"scale": [0.05, 0.04, 0.04]}}}
    write_json(root / "urdf/chests/chest.ao_config.json", config)

    def sandbox(change=lambda table, scene: None):
        scene = tiny_scene()
        del scene["object_instances"][1]
        change(scene["object_instances"][0], scene)
        write_scene(root, scene)
        return PlacementSandbox(load_scene(SceneDataset(root), SCENE), TEMPLATES)

    sandbox.root = root
    return sandbox


def spot(sandbox, name=sc.TABLE_LIGHT):
    (receptacle,) = receptacles_named(sandbox, (name,))
    return spot_of(sandbox, receptacle, {})


def test_a_spot_is_the_lower_face_of_the_box_and_turns_with_its_table(tiny):
    found = spot(tiny())
    # The table's middle is at (1, -2, 0.4); y-up (0, 0.5, 0) with half heights of 0.1 starts at
    # 0.4 above it and is 0.2 high.
    assert np.allclose(found.center_m, (1.0, -2.0, 0.8), atol=1e-6)
    assert np.allclose(found.half_m, (0.5, 0.3))
    assert found.height_m == pytest.approx(0.2)
    assert found.ref == (sc.TABLE_LIGHT, "table_:0000")
    half = math.sqrt(0.5)
    turned = spot(tiny(lambda table, _: table.update(rotation=[half, 0, half, 0])))
    assert np.allclose(turned.center_m, (1.0, -2.0, 0.8), atol=1e-6)
    # A quarter turn about the vertical swaps the axes.
    assert np.allclose(np.abs(turned.axes), [[0, 1], [1, 0], [0, 0]], atol=1e-6)


def test_what_is_in_a_drawer_goes_out_with_it(tiny):
    sandbox = tiny()
    closed = spot(sandbox, INSIDE)
    first, found = find_spots(sandbox, (INSIDE, sc.TABLE_LIGHT))
    assert first.ref == (sc.TABLE_LIGHT, "table_:0000"), "the order of the names does not count"
    # The slide's 0.25 m, at twice the size.
    assert found.joints == {"chest_:0000": {"slide": pytest.approx(0.5)}}
    assert sandbox.joints() == {"chest_:0000": {"slide": pytest.approx(0.5)}}, "it stays open"
    # From (-1, 0, 0.2), at twice the size: 0.6 ahead, and 0.18 - 0.08 up is the drawer's top.
    assert np.allclose(closed.center_m, (-0.4, 0.0, 0.3), atol=1e-6)
    assert np.allclose(found.center_m, (0.1, 0.0, 0.3), atol=1e-6)


def boards(root, name, size_m, *places):
    """Adds boards of a size to a layout, at these places (y-up)."""
    box_glb(root / f"objects/{name}.glb", size_m)
    config = {"render_asset": f"../../objects/{name}.glb", "use_bounding_box_for_collision": True}
    write_json(root / f"configs/objects/{name}.object_config.json", config)
    entries = [{"template_name": name, "translation": place} for place in places]
    return lambda table, scene: scene["object_instances"].extend(entries)


def tilted(angle):
    half = math.radians(angle) / 2
    return lambda table, _: table.update(rotation=[math.cos(half), math.sin(half), 0, 0])


def at_height(y):
    return lambda table, _: table.update(translation=[1, y, 2])


def test_only_what_can_be_used_is_used(tiny):
    lid, block, around = (1.2, 0.02, 0.8), (3.0, 0.5, 3.0), ((1, 0), (1, 4), (-1.1, 2), (3.1, 2))
    blocks = boards(tiny.root, "block", block, *([x, 0.25, z] for x, z in around))
    for change, reason in (
        # 0.8 m is the table's top; 0.1 m must be free above it.
        (boards(tiny.root, "high", lid, [1, 0.96, 2]), None),
        (boards(tiny.root, "low", lid, [1, 0.86, 2]), "covered"),
        (tilted(9), None),
        (tilted(11), "not level"),
        # The arm reaches 1.5 m; the top is 0.4 m above the table's middle.
        (at_height(1.05), None),
        (at_height(1.15), "higher than the arm reaches"),
        # The floor is free only farther than 1.1 m from the surface.
        (blocks, "too far from free floor"),
    ):
        sandbox = tiny(change)
        assert unusable(sandbox, spot(sandbox)) == reason
        assert bool(find_spots(sandbox, (sc.TABLE_LIGHT,))) == (reason is None), reason


def test_a_door_opens_as_far_as_nothing_is_in_its_way():
    dataset = resolve_dataset("apartment")
    scene = load_scene(dataset, sorted(dataset.scene_files)[0])
    apartment = PlacementSandbox(scene, TEMPLATES)
    apartment.show((BOX,))
    fridge = apartment.furniture("fridge")
    free = widest(apartment, fridge, "top_door_hinge")
    assert 1.2 < free <= 2.3 + 1e-6
    assert apartment.joints() == {}, "the door is not closed again"
    # A box in the middle of the door as it stands then, half of the door's 0.62 m from the hinge.
    apartment.set_joint(fridge, "top_door_hinge", free)
    middle = apartment.world_from(f"{fridge}/top_door") @ np.array([0.0, -0.31, 0.2, 1.0])
    apartment.set_joint(fridge, "top_door_hinge", 0.0)
    there = (*(float(x) for x in middle[:3]), 1.0, 0.0, 0.0, 0.0)
    apartment.place(BOX, there)
    blocked = widest(apartment, fridge, "top_door_hinge")
    # The box is 0.06 to 0.21 m wide: 0.1 rad at least, 1 rad at most.
    assert free - 1.0 < blocked < free - 0.1
    assert apartment.pose(BOX) == pytest.approx(there, abs=1e-6), "the box was pushed"
