"""Habitat's link ids, receptacles by body and position, and object frames."""

import math

import numpy as np
import pytest

from hab_tasks.episodes.habitat.fields import object_frame
from hab_tasks.episodes.habitat.layout import HabitatLayout, urdf_link_ids
from hab_tasks.errors import DatasetError
from hab_tasks.geometry import IDENTITY, pose
from hab_tasks.scenes.habitat.dataset import resolve_dataset
from hab_tasks.scenes.objects import load_objects
from hab_tasks.scenes.spec import (
    ArticulationInstance,
    ObjectInstance,
    ObjectTemplate,
    Receptacle,
    SceneSpec,
    Stage,
)

COUNTER = {
    "root": -1,
    "body": 0,
    "drawer1_bottom": 1,  # joint left_slide_bottom comes before left_slide_top
    "drawer1_top": 2,
    "drawer2_bottom": 3,
    "drawer2_middle": 4,
    "drawer2_top": 5,
    "drawer4": 6,  # joint right_slide_bottom
    "drawer3": 7,  # joint right_slide_top: the drawer of SetTable
}
FRIDGE = {"root": -1, "body": 0, "bottom_door": 1, "top_door": 2}

ORIGIN = "0 0 0"


def urdf(file, joints, links):
    """Writes a URDF of ``(joint, type, parent, child, xyz, rpy)``."""
    parts = [f'<link name="{name}"/>' for name in links]
    for name, kind, parent, child, xyz, rpy in joints:
        parts.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><limit lower="0" upper="1"/></joint>'
        )
    file.write_text(f'<robot name="x">{"".join(parts)}</robot>')
    return file


def test_links_are_numbered_depth_first_by_joint_name(tmp_path):
    file = urdf(
        tmp_path / "tree.urdf",
        [
            ("z_hinge", "revolute", "base", "left", "0 0 0", "0 0 0"),
            ("b_fixed", "fixed", "base", "right", "0 0 0", "0 0 0"),
            ("c_slide", "prismatic", "right", "tray", "0 0 0", "0 0 0"),
            ("a_slide", "prismatic", "left", "box", "0 0 0", "0 0 0"),
        ],
        ("box", "left", "tray", "base", "right"),
    )
    # b_fixed comes before z_hinge, and all that hangs on `right` before `left`.
    assert urdf_link_ids(file) == {"base": -1, "right": 0, "tray": 1, "left": 2, "box": 3}


def test_what_is_not_one_tree_is_refused(tmp_path):
    back = ("k", "fixed", "b", "a", ORIGIN, ORIGIN)
    for joints, links, words in (
        ([], "ab", "no joint"),
        ([("j", "fixed", "a", "b", ORIGIN, ORIGIN), back], "ab", "hangs on itself"),
        ([("j", "fixed", "a", "nowhere", ORIGIN, ORIGIN)], "a", "'nowhere'"),
    ):
        file = urdf(tmp_path / "bad.urdf", joints, links)
        with pytest.raises(DatasetError, match=rf"bad\.urdf: .*{words}"):
            urdf_link_ids(file)


@pytest.mark.parametrize("which", ["apartment", pytest.param(None, marks=pytest.mark.assets)])
def test_ids_of_the_furniture(which, request):
    dataset = resolve_dataset(which or request.getfixturevalue("replica_cad"))
    assert urdf_link_ids(dataset.urdf_files["kitchen_counter"]) == COUNTER
    assert urdf_link_ids(dataset.urdf_files["fridge"]) == FRIDGE


# Receptacles -----------------------------------------------------------------------------------


def box(name, body, position):
    return Receptacle(
        name=name,
        body=body,
        body_from_box=pose(position, (1, 0, 0, 0)),
        half_size_m=(0.2, 0.2, 0.05),
        up=(0, 0, 1),
    )


@pytest.fixture
def layout(tmp_path):
    """A cupboard at (10, 0, 0), scale 2, whose body lies on its side, and two equal stools."""
    file = urdf(
        tmp_path / "cupboard.urdf",
        [
            ("lift", "fixed", "root", "body", "0 0 1", f"{math.pi / 2} 0 0"),
            ("door", "revolute", "body", "leaf", "0 0 0", "0 0 0"),
        ],
        ("root", "body", "leaf"),
    )
    cupboard = ArticulationInstance(
        name="cupboard_:0000",
        template="cupboard",
        urdf_file=file,
        world_from_root=pose((10, 0, 0), (1, 0, 0, 0)),
        scale=2.0,
    )
    template = ObjectTemplate(
        name="stool",
        visual_file=None,
        collision=(),
        mass_kg=1.0,
        friction=0.5,
        up=(0, 1, 0),
    )
    stools = [
        ObjectInstance(
            name=f"stool_:000{i}",
            template=template,
            world_from_object=pose((i, 5, 0), (1, 0, 0, 0)),
            dynamic=False,
        )
        for i in (0, 1)
    ]
    return HabitatLayout(
        SceneSpec(
            scene_id="room",
            dataset="test",
            stage=Stage(
                name="s", visual_file=None, collision=(), world_from_stage=IDENTITY, friction=0.5
            ),
            objects=tuple(stools),
            articulations=(cupboard,),
            receptacles=(
                box("low", "cupboard_:0000/body", (0, -0.4, 0)),
                box("high", "cupboard_:0000/body", (0, 0.4, 0)),
                box("inside", "cupboard_:0000/leaf", (0, 0, 0)),
                box("seat", "stool_:0000", (0, 0, 0)),
                box("seat", "stool_:0001", (0, 0, 0)),
            ),
            lights=(),
        )
    )


def test_the_nearest_receptacle_of_a_body_is_meant_unless_it_is_named(layout):
    # The body's y axis points up, and it stands 2 m high (the joint's 1 m at scale 2): the boxes,
    # whose positions are already to scale, are at (10, 0, 1.6) and (10, 0, 2.4).
    near = {1.5: "low", 1.9: "low", 2.1: "high", 3.0: "high"}
    for height, name in near.items():
        found = layout.receptacle("cupboard_:0000", 0, None, np.array([10, 0, height]))
        assert found == (name, "cupboard_:0000/body")
    point = np.array([10, 0, 3.0])
    assert layout.receptacle("cupboard_:0000", 0, "low", point)[0] == "low"
    assert layout.receptacle("cupboard_:0000", 0, "seat", point)[0] == "high", "not on that body"
    assert layout.receptacle(None, None, "seat", np.array([0.9, 5, 0])) == ("seat", "stool_:0001")
    assert layout.receptacle(None, None, None, point) is None


# Frames ----------------------------------------------------------------------------------------


@pytest.mark.assets
def test_the_frame_of_a_scan_is_upright_and_in_its_middle(ycb):
    frame = object_frame(load_objects(ycb)["003_cracker_box"])
    np.testing.assert_allclose(frame[:3, :3], [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-12)
    # The scan's box is x [-0.049, 0.022], y [-0.096, 0.068], z [-0.004, 0.210].
    np.testing.assert_allclose(frame @ [-0.0135, -0.014, 0.103, 1], [0, 0, 0, 1], atol=2e-3)
