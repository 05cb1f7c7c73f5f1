"""Object templates of the embedded dataset stand by themselves, and hollow ones hold things."""

import math

import numpy as np
import sapien
from apartment_solids import ROOT, collision_of, object_config

NAMES = sorted(p.name.split(".")[0] for p in (ROOT / "configs/objects").glob("*.json"))
# What hangs on a wall: it does not rest on a floor by itself.
HANGING = {f"frl_apartment_{n}" for n in ["picture_01", "picture_02", "picture_03", "tv_screen"]}
# What is put into them.
HELD = {
    "013_apple": "bowl_01 bowl_02 bowl_03 pan_01",
    "017_orange": "bowl_06 bowl_07",
    "009_gelatin_box": "plate_01",
    "024_bowl": "plate_02",
    "025_mug": "kitchen_utensil_05",
    "002_master_chef_can": "basket",
    "005_tomato_soup_can": "box",
    "003_cracker_box": "bin_03",
}
HALF = math.sqrt(0.5)
Z_UP = sapien.Pose(q=[HALF, HALF, 0, 0])  # y-up to z-up
STEP_S, SECONDS, DROP_M, SPACING_M = 1 / 120, 2, 0.005, 3.5


def bare_scene():
    """A scene with a floor and without a renderer."""
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    scene.set_timestep(STEP_S)
    builder = scene.create_actor_builder()
    builder.add_box_collision(sapien.Pose([0, 0, -0.05]), [100, 100, 0.05])
    builder.initial_pose = sapien.Pose()
    builder.build_static()
    return scene


def bounds(name):
    """The lowest and highest coordinates (2, 3) of the collision shapes."""
    corners = np.vstack([m.vertices for m in collision_of(*object_config(name))])
    return np.array([corners.min(axis=0), corners.max(axis=0)])


def add(scene, name, place, *, above_m=0.0):
    """Drops a template upright; returns its actor and where it should come to rest."""
    path, config = object_config(name)
    friction = config["friction_coefficient"]
    builder = scene.create_actor_builder()
    material = sapien.physx.PhysxMaterial(friction, friction, 0.0)
    file = (path.parent / config["collision_asset"]).resolve()
    builder.add_multiple_convex_collisions_from_file(str(file), material=material)
    rest = sapien.Pose([*place, above_m - bounds(name)[0, 1]]) * Z_UP
    builder.initial_pose = sapien.Pose([0, 0, DROP_M]) * rest
    actor = builder.build(name=name)
    actor.find_component_by_type(sapien.physx.PhysxRigidDynamicComponent).mass = config["mass"]
    return actor, rest


def test_everything_stands_where_it_is_put():
    """After two seconds; all that stands or lies by itself."""
    scene, dropped = bare_scene(), {}
    for index, name in enumerate(n for n in NAMES if n not in HANGING):
        row, column = divmod(index, 12)
        dropped[name] = add(scene, name, (SPACING_M * column, SPACING_M * row))
    for _ in range(round(SECONDS / STEP_S)):
        scene.step()
    for name, (actor, rest) in dropped.items():
        assert np.linalg.norm(actor.pose.p - rest.p) < 0.01, name
        turn_rad = 2 * math.acos(min(1.0, abs(float((rest.inv() * actor.pose).q[0]))))
        assert math.degrees(turn_rad) < 5, name


def test_hollow_things_hold_what_is_put_in_them():
    scene, pairs = bare_scene(), []
    put = [(f"frl_apartment_{name}", held) for held in HELD for name in HELD[held].split()]
    for index, (holder, held) in enumerate(put):
        place = (SPACING_M * index, 0.0)
        inner, _ = add(scene, held, place, above_m=0.03)
        pairs.append((holder, inner, *add(scene, holder, place)))
    for _ in range(round(SECONDS / STEP_S)):
        scene.step()
    for holder, inner, outer, rest in pairs:
        place, (low, high) = (outer.pose.inv() * inner.pose).p, bounds(holder)
        assert (low < place).all(), holder
        assert (place < high)[[0, 2]].all(), holder
        assert np.linalg.norm(outer.pose.p - rest.p) < 0.03, holder
