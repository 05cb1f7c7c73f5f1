"""URDF files that the engine cannot build, or would build incorrectly."""

from builders import cpu_scene
from faulty_data import (
    URDF,
    Damage,
    cut,
    folder,
    read_as_env,
    refused_with,
    swap,
    text,
    whole_dataset,
)
from refusals import check_each

from hab_tasks.scenes.pool import BodyPool

BOX = 'size="0.4 0.3, 0.2"'
MASS = '<mass value="5"/>'
ORIGIN = '<origin xyz="0.3, 0, 0"/>'
AXIS = '<axis xyz="1, 0, 0"/>'
ENDS = '<parent link="body"/><child link="drawer"/>'
END = "</robot>"
SECOND_JOINT = f'<joint name="again" type="fixed">{ENDS}</joint></robot>'


CASES: dict[str, tuple[Damage, str]] = {
    "empty": (text(""), "not a valid URDF"),
    "cut": (cut(0.4), "not a valid URDF"),
    "deep": (text("<robot>" + 20_000 * "<a>" + 20_000 * "</a>" + "</robot>"), "nested"),
    "folder": (folder, "a folder"),
    "no link": (text("<robot/>"), "no link"),
    "no joint": (text('<robot><link name="body"/></robot>'), "no joint"),
    # Names and the tree
    "nameless link": (swap('<link name="drawer">', "<link>"), "a link has no name"),
    "two links of a name": (swap('name="drawer"', 'name="body"'), "link 'body' is there 2 times"),
    "unknown parent": (swap('<parent link="body"/>', '<parent link="bdy"/>'), "'bdy'"),
    "no parent": (swap('<parent link="body"/>', ""), "0 elements <parent>"),
    "child of two": (swap(END, SECOND_JOINT), "the child of 2 joints"),
    "two roots": (swap(END, '<link name="leg"/></robot>'), "'leg' hang on no joint"),
    "cycle": (swap(ENDS, '<parent link="drawer"/><child link="drawer"/>'), "itself"),
    # Joints
    "unknown type": (swap("prismatic", "prismatik"), "Did you mean 'prismatic'"),
    "limit of text": (swap('upper="0.25"', 'upper="far"'), "limit upper is 'far'"),
    "limits swapped": (swap('lower="0"', 'lower="1"'), "lower before upper"),
    "effort of text": (swap('effort="10"', 'effort="much"'), "limit effort is 'much'"),
    "axis zero": (swap(AXIS, '<axis xyz="0 0 0"/>'), "axis is '0 0 0'"),
    "friction negative": (swap(AXIS, AXIS + '<dynamics friction="-1"/>'), "dynamics friction"),
    "mimic unknown": (swap(AXIS, AXIS + '<mimic joint="glide"/>'), "'glide'"),
    "mimic text": (swap(AXIS, AXIS + '<mimic joint="slide" offset="a"/>'), "mimic offset is 'a'"),
    # Masses
    "mass negative": (swap(MASS, '<mass value="-5"/>'), "link 'body', inertial, mass value is -5"),
    "inertia negative": (swap('ixx="1"', 'ixx="-1"'), "positive definite"),
    # Shapes
    "box of two": (swap(BOX, 'size="0.4 0.3"'), "collision 0, box size is [0.4, 0.3]"),
    "box flat": (swap(BOX, 'size="0.4 0 0.2"'), "3 numbers above 0"),
    "sphere of zero": (swap(f"<box {BOX}/>", '<sphere radius="0"/>'), "sphere radius is 0"),
    "unknown shape": (swap(f"<box {BOX}/>", '<cone radius="1"/>'), "['cone']"),
    "origin nan": (swap(ORIGIN, '<origin xyz="nan 0 0"/>'), "collision 0, origin xyz"),
    "missing mesh": (swap('"body.glb"', '"gone.glb"'), "'gone.glb'"),
    "mesh folder": (swap('"body.glb"', '"."'), "a folder"),
    "mesh scale zero": (swap('scale="1, 1, 1"', 'scale="1 0 1"'), "scale is '1 0 1'"),
    "colour": (swap("</visual>", '<material><color rgba="red"/></material></visual>'), "['red']"),
}


def test_a_faulty_urdf_is_named(tmp_path):
    def check(case):
        damage, element = case
        refused_with(tmp_path, URDF, damage, "chest.urdf", element)

    check_each(CASES, check)


def test_what_the_engine_does_not_use_may_be_anything(tmp_path):
    root = whole_dataset(tmp_path / "data")
    swap(AXIS, AXIS + '<safety_controller k_velocity="a"/><calibration rising="b"/>')(root / URDF)
    swap(END, "<transmission/><gazebo><sensor><camera/></sensor></gazebo></robot>")(root / URDF)
    handles = BodyPool(cpu_scene(), {}).show(read_as_env(root), ())
    assert len(handles.articulations["chest_:0000"].active_joints) == 1
