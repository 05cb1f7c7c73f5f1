"""The embedded dataset at rest in SAPIEN: doors do not move, and dropped objects settle."""

import json
import math
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
import trimesh

sapien = pytest.importorskip("sapien")

ROOT = Path(__file__).parents[2] / "assets" / "apartment"
OBJECTS = ROOT / "configs/objects"
HALF = math.sqrt(0.5)
Z_UP = sapien.Pose(q=[HALF, HALF, 0, 0])  # y-up to z-up
PICKABLES = sorted(p.name.split(".")[0] for p in OBJECTS.glob("0*.json"))
STEP_S, SECONDS = 1 / 120, 2
pytestmark = pytest.mark.render  # SAPIEN's URDF loader makes materials, which need a device


def load(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))


def receptacles(config: dict) -> list[dict]:
    return [v for k, v in config["user_defined"].items() if k.startswith("receptacle_aabb_")]


def add_object(scene, name, pose, *, still):
    config = load(OBJECTS / f"{name}.object_config.json")
    builder = scene.create_actor_builder()
    builder.add_multiple_convex_collisions_from_file(
        str((OBJECTS / config["collision_asset"]).resolve())
    )
    builder.initial_pose = pose
    return builder.build_static(name=name) if still else builder.build(name=name)


def add_articulation(scene, item):
    name = item["template_name"]
    loader = scene.create_urdf_loader()
    loader.fix_root_link = True
    body = loader.load(str(ROOT / "urdf" / name / f"{name}.urdf"))
    body.set_root_pose(Z_UP * sapien.Pose(item["translation"], item["rotation"]))
    return body


@pytest.fixture
def world():
    """The furnished scene, and the pose and config of every receptacle."""
    scene = sapien.Scene()
    scene.set_timestep(STEP_S)
    config, places, bodies = (
        load(ROOT / "configs/scenes/v3_sc0_staging_00.scene_instance.json"),
        [],
        {},
    )
    for item in config["object_instances"]:
        pose = Z_UP * sapien.Pose(item["translation"], item["rotation"])
        add_object(scene, item["template_name"], pose, still=True)
        own = load(OBJECTS / f"{item['template_name']}.object_config.json")
        places += [(pose, r) for r in receptacles(own)]
    for item in config["articulated_object_instances"]:
        name = item["template_name"]
        bodies[name] = add_articulation(scene, item)
        links = {link.name: link for link in bodies[name].links}
        own = load(ROOT / "urdf" / name / f"{name}.ao_config.json")
        places += [(links[r["parent_link"]].entity_pose, r) for r in receptacles(own)]
    return scene, bodies, places


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_doors_and_drawers_stay_where_they_are(world, share):
    scene, bodies, _ = world
    start = {}
    for name, body in bodies.items():
        lower, upper = np.array(body.get_qlimits()).T
        closed = np.where(np.abs(lower) < np.abs(upper), lower, upper)
        start[name] = closed + share * (lower + upper - 2 * closed)
        body.set_qpos(start[name])
    moved = dict.fromkeys(bodies, 0.0)
    for _ in range(round(SECONDS / STEP_S)):
        scene.step()
        for name, body in bodies.items():
            moved[name] = max(moved[name], float(np.abs(body.get_qpos() - start[name]).max()))
    assert max(moved.values()) < 1e-3, moved


def test_pickables_settle_on_every_receptacle(world):
    scene, _, places = world
    heights = {}
    for name in PICKABLES:
        file = ROOT / "objects/convex" / f"{name}_cv_decomp.glb"
        heights[name] = trimesh.load(file, force="scene").bounds[:, 1]
    names, dropped = cycle(PICKABLES), []
    for pose, receptacle in places:
        up = np.array(receptacle.get("up", [0, 1, 0]), float)
        half = abs(float(np.dot(receptacle["scale"], up)))
        name = next(n for n in names if np.ptp(heights[n]) < 2 * half - 0.01)
        bottom = (pose * sapien.Pose(np.array(receptacle["position"]) - half * up)).p
        rest = bottom - np.array([0, 0, heights[name][0]])
        start = sapien.Pose(rest + np.array([0, 0, 0.003]), Z_UP.q)
        dropped.append(
            (receptacle["name"], name, rest, add_object(scene, name, start, still=False))
        )
    for _ in range(round(SECONDS / STEP_S)):
        scene.step()
    for place, name, rest, actor in dropped:
        body = actor.find_component_by_type(sapien.physx.PhysxRigidDynamicComponent)
        assert np.linalg.norm(body.linear_velocity) < 0.01, f"{name} on {place}"
        assert np.linalg.norm(actor.pose.p - rest) < 0.012, f"{name} on {place}"
