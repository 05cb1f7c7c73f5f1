"""Reuse of bodies: a layout shown again equals the first time, without remains of others."""

import numpy as np
import pytest
import sapien
import torch
from builders import box_glb, cpu_scene, tiny_dataset, tiny_scene, write_json, write_scene

from hab_tasks.world.scenes.habitat.dataset import SceneDataset, resolve_dataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.objects import load_objects
from hab_tasks.world.scenes.physics import FLOOR_BIT
from hab_tasks.world.scenes.pool import BodyPool, components, matrix

PICKABLES = ("003_cracker_box_:0000", "024_bowl_:0000", "024_bowl_:0001")


class Room:
    """A simulation with a pool that shows layouts in it."""

    def __init__(self):
        self.scene = cpu_scene()
        self.pool = BodyPool(self.scene, load_objects(None))

    def show(self, *specs):
        """Shows one layout after another, furniture closed; returns itself."""
        for spec in specs:
            self.bodies = self.pool.show(spec, PICKABLES)
            for furniture in self.bodies.articulations.values():
                furniture.set_qpos(torch.zeros_like(furniture.get_qpos()))
        return self

    def groups(self):
        """Body -> the collision bits of its shapes, and which shapes share an ignore number."""
        numbers, found = {}, {}
        for name, _, component in components(self.bodies):
            bits = [shape.get_collision_groups() for shape in component.collision_shapes]
            found[name] = [(*b[:3], numbers.setdefault(b[3], len(numbers))) for b in bits]
        return found

    def facts(self):
        scene, registry = self.scene, self.scene.state_dict_registry
        lists = (scene.actors, scene.articulations, registry.actors, registry.articulations)
        return {
            "poses": {name: matrix(c.entity_pose) for name, _, c in components(self.bodies)},
            "groups": self.groups(),
            "state": {kind: list(group) for kind, group in scene.get_sim_state().items()},
            "shapes": {
                body.name: [body.group, *(list(vars(shape).values()) for shape in body.shapes)]
                for body in self.pool.bodies()
            },
            "masses": {name: a._bodies[0].mass for name, a in self.bodies.movable.items()},
            "entities": sorted(entity.name for entity in scene.sub_scenes[0].entities),
            "what ManiSkill knows by name": [list(group) for group in lists],
        }


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
    return [load_scene(SceneDataset(root), f"v3_sc0_staging_0{i}") for i in (0, 1)]


@pytest.mark.parametrize(
    "name", ["tiny", "apartment", pytest.param("replica_cad", marks=pytest.mark.assets)]
)
def test_a_layout_shown_after_others_equals_a_new_one(name, request):
    """To the last bit; the apartments of ReplicaCAD have loose furniture."""
    if name == "tiny":
        first, *others = request.getfixturevalue(name)
    else:
        root = name if name == "apartment" else request.getfixturevalue(name)
        dataset = resolve_dataset(root)
        scenes = ("v3_sc0_staging_00", "v3_sc1_staging_05", "apt_0")
        first, *others = [load_scene(dataset, scene) for scene in scenes]
    for spec, *before in ((first, first, *others), *((other, first) for other in others)):
        fresh, worn = Room().show(spec).facts(), Room().show(*before, spec).facts()
        for fact in fresh:
            assert alike(worn[fact], fresh[fact]), (fact, spec.scene_id)


def test_layouts_share_what_is_alike(tiny):
    room = Room()
    tables = [room.show(spec).bodies.static["table_:0000"] for spec in (*tiny, *tiny)]
    assert all(table is tables[0] for table in tables)


def test_what_is_not_shown_is_not_met_and_a_rug_on_a_table_does_not_spare_the_base(tiny):
    """A cube falls where the other layout's table stood: 2 s are enough to fall from 1.5 m."""
    room = Room()
    for spec, flat in zip(reversed(tiny), (False, True), strict=True):
        (bits,) = room.show(spec).groups()["rug_:0000"]
        assert bool(bits[2] & FLOOR_BIT) == flat
    cube = room.bodies.loose["cube_:0000"]
    cube._objs[0].set_pose(sapien.Pose([-1, -1, 1.5]))
    shown = {component for _, _, component in components(room.bodies)}
    for _ in range(240):
        room.scene.px.step()
        assert {b for c in room.scene.px.get_contacts() for b in c.bodies} <= shown
    # On the floor, whatever side it lies on: half of 0.1, 0.2 or 0.3 m.
    assert float(cube.pose.p[0, 2]) < 0.16
