"""Joint friction of doors and drawers: they resist a touch, and stop when released."""

import numpy as np
import pytest
from builders import DRAWER_URDF, cpu_scene

from hab_tasks.world.scenes.build import BodyBuilder
from hab_tasks.world.scenes.habitat.dataset import resolve_dataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.physics import HINGE, SLIDE
from hab_tasks.world.scenes.urdf import joint_frictions


def pushed(scene, furniture, effort, speed=0.0):
    """Runs one second with an effort on the closed first joint; returns its position and speed."""
    first = np.eye(furniture.dof)[0]
    furniture.qpos, furniture.qvel = 0.0 * first, speed * first
    for _ in range(120):
        furniture.set_qf(effort * first)
        scene.px.step()
    return float(furniture.qpos[0]), float(furniture.qvel[0])


@pytest.mark.parametrize("which", ["apartment", pytest.param(None, marks=pytest.mark.assets)])
def test_a_joint_moves_only_when_pushed_harder_than_its_friction_and_stops(which, request):
    dataset = resolve_dataset(which or request.getfixturevalue("replica_cad"))
    scene, built = cpu_scene(), {}
    spec = load_scene(dataset, "v3_sc0_staging_00")
    for group, item in enumerate(spec.articulations, start=1):
        built[item.template] = BodyBuilder(scene).articulation(item, group)._objs[0]
    scene._setup(enable_gpu=False)
    joints = [joint for piece in built.values() for joint in piece.active_joints]
    assert len(joints) > 20
    for joint in joints:
        low, high = (2.0, 8.0) if joint.type == "prismatic" else (0.3, 1.0)
        assert low <= joint.force_limit <= high, joint.name
        assert joint.damping > 1e3, joint.name
    for template, kind in (("kitchen_counter", SLIDE), ("fridge", HINGE)):
        still, _ = pushed(scene, built[template], 0.9 * kind.usual)
        assert abs(still) < 2e-3, template
        # 3 times the friction leaves twice of it: a fridge door of 1.3 kg m^2 gets 1.6 N m, a
        # drawer of 5 kg 8 N. In one second that is 0.5 * 1.2 rad and 0.5 * 1.6 m, damping left
        # aside.
        moved, _ = pushed(scene, built[template], 3 * kind.usual)
        assert moved > 0.2, template
        # v' = -F / m - d v. The fridge: F / I = 0.8 or 0.62, d = 2.5: 0.5 rad/s is gone after
        # ln(1 + 0.5 d I / F) / d = 0.38 or 0.44 s; the drawer: F / m = 0.8, d = 2, after 0.4 s.
        position, speed = pushed(scene, built[template], 0.0, speed=0.5)
        assert abs(speed) < 1e-3, template
        assert 0.05 < position < 0.2, template


def test_a_urdf_that_states_friction_wins_and_a_placeholder_does_not(tmp_path):
    stated = DRAWER_URDF.replace("<parent", '<dynamics friction="6.5"/><parent')
    for text, frictions in ((stated, {"slide": 6.5}), (DRAWER_URDF, {})):
        file = tmp_path / f"{len(frictions)}.urdf"
        file.write_text(text)
        assert joint_frictions(file) == frictions
    assert [SLIDE.of(stated) for stated in (6.5, 0.01, None)] == [6.5, 4.0, 4.0]
    assert HINGE.of(0.01) == HINGE.of(None) == 0.8
