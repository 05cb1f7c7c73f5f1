"""Reuse of bodies: a layout shown again equals the first time, without remains of others."""

import numpy as np
import pytest
import sapien
import torch
from builders import box_glb, cpu_scene, tiny_dataset, tiny_scene, write_json, write_scene

from hab_tasks.scenes.collision_groups import FLOOR_BIT
from hab_tasks.scenes.habitat.dataset import SceneDataset, resolve_dataset
from hab_tasks.scenes.habitat.load import load_scene
from hab_tasks.scenes.objects import load_objects
from hab_tasks.scenes.pool import BodyPool
from hab_tasks.scenes.shapes import components, matrix

PICKABLES = ("003_cracker_box_:0000", "024_bowl_:0000", "024_bowl_:0001")
TEMPLATES = load_objects(None)


class Room:
    """A simulation with a pool that shows layouts in it."""

    def __init__(self):
        self.scene = cpu_scene()
        self.pool = BodyPool(self.scene, TEMPLATES)

    def show(self, *specs, objects=PICKABLES):
        """Shows one layout after another, furniture closed; returns itself."""
        for spec in specs:
            self.scene_bodies = self.pool.show(spec, objects)
            for furniture in self.scene_bodies.articulations.values():
                furniture.set_qpos(torch.zeros_like(furniture.get_qpos()))
        return self

    def poses(self):
        return {name: matrix(c.entity_pose) for name, _, c in components(self.scene_bodies)}

    def groups(self):
        """Body -> the collision bits of its shapes, and which shapes share an ignore number."""
        numbers, found = {}, {}
        for name, _, component in components(self.scene_bodies):
            bits = [shape.get_collision_groups() for shape in component.collision_shapes]
            shared = [numbers.setdefault(b[3], len(numbers)) for b in bits]
            found[name] = [(*b[:3], number) for b, number in zip(bits, shared, strict=True)]
        return found

    def state_keys(self):
        return {kind: list(group) for kind, group in self.scene.get_sim_state().items()}

    def shapes(self):
        return {
            body.name: (
                body.group,
                [
                    (s.kind, s.body_from_shape, s.half_size_m, s.vertices_m, s.faces)
                    for s in body.shapes
                ],
            )
            for body in self.pool.bodies()
        }

    def masses(self):
        return {name: actor._bodies[0].mass for name, actor in self.scene_bodies.movable.items()}

    def entities(self):
        return sorted(entity.name for entity in self.scene.sub_scenes[0].entities)

    def listed(self):
        """What ManiSkill knows by name, in its order."""
        scene = self.scene
        registry = scene.state_dict_registry
        lists = (scene.actors, scene.articulations, registry.actors, registry.articulations)
        return [list(group) for group in lists]


FACTS = ("poses", "groups", "state_keys", "shapes", "masses", "entities", "listed")


def alike(a, b):
    """Whether two nested values are equal to the last bit, in the same order."""
    if isinstance(a, dict):
        return list(a) == list(b) and all(alike(a[key], b[key]) for key in a)
    if isinstance(a, (list, tuple)):
        return len(a) == len(b) and all(alike(x, y) for x, y in zip(a, b, strict=True))
    return np.array_equal(a, b)


def second_scene() -> dict:
    """Table and rug change places in height, the cube does not move by itself, the chest shrinks.

    The rug lies on the floor in one layout and on the table in the other: flat here, not there.
    """
    scene = tiny_scene()
    table, cube = scene["object_instances"]
    table["translation"] = [-1, 0.4, 1]
    cube |= {"motion_type": "STATIC", "translation": [3, 0.15, 0]}
    scene["object_instances"] += [
        {"template_name": "rug", "translation": [-1, 0.81, 1]},
        {"template_name": "cube", "translation": [3, 0.5, 0], "motion_type": "DYNAMIC"},
    ]
    chest = scene["articulated_object_instances"][0]
    chest |= {"uniform_scale": 1.0, "translation": [2, 0.1, 2], "rotation": [0, 0, 1, 0]}
    return scene


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """Two layouts that differ in everything: places, sizes, what is fixed and what is there."""
    root = tiny_dataset(tmp_path_factory.mktemp("tiny"))
    box_glb(root / "objects/rug.glb", (1.0, 0.02, 1.0))
    rug = {"render_asset": "../../objects/rug.glb", "use_bounding_box_for_collision": True}
    write_json(root / "configs/objects/rug.object_config.json", rug)
    first = tiny_scene()
    first["object_instances"] += [{"template_name": "rug", "translation": [3, 0.01, 0]}]
    write_scene(root, first)
    write_scene(root, second_scene(), "v3_sc0_staging_01")
    dataset = SceneDataset(root)
    return [load_scene(dataset, f"v3_sc0_staging_0{i}") for i in (0, 1)]


@pytest.fixture(scope="module")
def apartment():
    """The first and the last layout of the apartment, as many as it has."""
    dataset = resolve_dataset("apartment")
    names = sorted(dataset.scene_files)
    return [load_scene(dataset, name) for name in dict.fromkeys((names[0], names[-1]))]


@pytest.fixture(scope="module")
def real(replica_cad):
    """Two staged layouts and a furnished one, whose furniture is loose."""
    dataset = SceneDataset(replica_cad)
    return [load_scene(dataset, s) for s in ("v3_sc0_staging_00", "v3_sc1_staging_05", "apt_0")]


every_dataset = pytest.mark.parametrize(
    "dataset", ["tiny", "apartment", pytest.param("real", marks=pytest.mark.assets)]
)


@pytest.fixture
def layouts(dataset, request):
    return request.getfixturevalue(dataset)


@every_dataset
def test_a_layout_shown_after_others_equals_a_new_one(layouts):
    """To the last bit: poses, collision groups, keys of the state, shapes, masses, entities."""
    first, *others = layouts
    for spec, *before in ((first, first, *others), *((other, first) for other in others)):
        fresh, worn = Room().show(spec), Room().show(*before, spec)
        for fact in FACTS:
            assert alike(getattr(worn, fact)(), getattr(fresh, fact)()), (fact, spec.scene_id)


def test_nothing_is_built_twice_and_layouts_share_what_is_alike(tiny):
    """Stage, table, rug and cracker box; not the cube (fixed or loose) and the chest (its size)."""
    room = Room().show(tiny[0], objects=PICKABLES[:1])
    # stage, table, cube, rug, chest, cracker box
    assert len(room.pool._built) == 6
    table = room.scene_bodies.static["table_:0000"]
    room.show(tiny[1], objects=PICKABLES[:1])
    # and the fixed cube, the second loose cube, the smaller chest
    assert len(room.pool._built) == 9
    assert room.scene_bodies.static["table_:0000"] is table
    built = [id(actor) for actor in room.pool._built.values()]
    room.show(*tiny, *reversed(tiny), objects=PICKABLES[:1])
    assert [id(actor) for actor in room.pool._built.values()] == built


def test_a_rug_spares_the_robots_base_only_on_the_floor(tiny):
    room = Room()
    for spec, flat in ((tiny[0], True), (tiny[1], False), (tiny[0], True)):
        room.show(spec)
        (bits,) = room.groups()["rug_:0000"]
        assert bool(bits[2] & FLOOR_BIT) == flat


def test_what_is_not_shown_is_not_met(tiny):
    """A cube falls where the other layout's table stood: 2 s are enough to fall from 1.5 m."""
    room = Room().show(*reversed(tiny))
    cube = room.scene_bodies.loose["cube_:0000"]
    cube._objs[0].set_pose(sapien.Pose([-1, -1, 1.5]))
    shown = {component for _, _, component in components(room.scene_bodies)}
    for _ in range(240):
        room.scene.px.step()
        assert {b for c in room.scene.px.get_contacts() for b in c.bodies} <= shown
    # On the floor, whatever side it lies on: half of 0.1, 0.2 or 0.3 m.
    assert float(cube.pose.p[0, 2]) < 0.16
