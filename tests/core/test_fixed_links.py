"""Links on fixed joints are merged into their parents; the robot stays the same body."""

from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

from hab_tasks.robots.description import simulated_urdf
from hab_tasks.robots.fetch import FETCH
from hab_tasks.world.scenes.fixed_links import merge_fixed_links

CHAIN = """<robot name="r">
  <link name="a">
    <inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
  </link>
  <link name="b">
    <inertial>
      <origin xyz="1 0 0"/><mass value="3"/>
      <inertia ixx="1" ixy="0" ixz="0" iyy="2" iyz="0" izz="3"/>
    </inertial>
    <collision><origin xyz="0 0 0.5"/><geometry><sphere radius="1"/></geometry></collision>
  </link>
  <link name="empty"/>
  <link name="c"/>
  <joint name="ab" type="fixed">
    <origin xyz="0 1 0" rpy="0 0 1.5707963267948966"/><parent link="a"/><child link="b"/>
  </joint>
  <joint name="be" type="fixed"><parent link="b"/><child link="empty"/></joint>
  <joint name="bc" type="revolute">
    <origin xyz="2 0 0"/><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>
  </joint>
</robot>"""


def numbers(element, name):
    return [float(part) for part in element.get(name).split()]


def test_a_link_becomes_part_of_its_parent_unless_it_is_kept():
    root = ElementTree.fromstring(CHAIN)
    merge_fixed_links(root)
    assert [link.get("name") for link in root.findall("link")] == ["a", "c"]
    (joint,) = root.findall("joint")
    # b is turned by 90 degrees about z at (0, 1, 0): its (2, 0, 0) is (0, 3, 0) of a.
    assert joint.find("parent").get("link") == "a"
    assert numbers(joint.find("origin"), "xyz") == pytest.approx([0, 3, 0])
    assert numbers(joint.find("origin"), "rpy") == pytest.approx([0, 0, np.pi / 2])
    link = root.find("link")
    assert numbers(link.find("collision/origin"), "xyz") == pytest.approx([0, 1, 0.5])
    # Mass 1 at the origin, and 3 at (0, 2, 0), since b's (1, 0, 0) lies there: together at 1.5.
    assert float(link.find("inertial/mass").get("value")) == 4
    assert numbers(link.find("inertial/origin"), "xyz") == pytest.approx([0, 1.5, 0])
    # b's own moments about a's axes are (2, 1, 3). Steiner: 1 kg at 1.5 m, 3 kg at 0.5 m give 3.
    inertia = link.find("inertial/inertia")
    moments = [float(inertia.get(name)) for name in ("ixx", "iyy", "izz", "ixy")]
    assert moments == pytest.approx([1 + 2 + 3, 1 + 1, 1 + 3 + 3, 0])
    root = ElementTree.fromstring(CHAIN)
    merge_fixed_links(root, keep={"b"})
    assert [link.get("name") for link in root.findall("link")] == ["a", "b", "c"]


def test_fetch_is_the_same_body():
    whole = pin.buildModelFromXML(ElementTree.tostring(FETCH.urdf_tree(), encoding="unicode"))
    merged = pin.buildModelFromXML(simulated_urdf(FETCH, visuals=False))
    assert list(merged.names) == list(whole.names)
    qpos, models = pin.randomConfiguration(whole), (whole, merged)
    inertias = [pin.crba(model, model.createData(), qpos) for model in models]
    np.testing.assert_allclose(*inertias, rtol=1e-6, atol=1e-6)
    masses = [sum(one.mass for one in model.inertias) for model in models]
    assert masses[0] == pytest.approx(masses[1])
