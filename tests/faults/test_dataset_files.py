"""Invalid JSON and URDF files of a dataset, and layouts that hold too much."""

import math
import tempfile
from pathlib import Path

from builders import tiny_scene, write_scene
from faulty_data import (
    AO,
    CONFIG,
    CUBE,
    GONE,
    LEXICON,
    LIGHTS,
    RECEPTACLE,
    SCENE,
    STAGE,
    TABLE,
    URDF,
    Damage,
    cut,
    folder,
    loop,
    pipe,
    put,
    read_as_env,
    refused_everywhere,
    refused_with,
    swap,
    text,
    whole_dataset,
)
from refusals import check_each

from hab_tasks.world.scenes.habitat.load import MOST_FURNITURE

FILES = (CONFIG, SCENE, TABLE, STAGE, LIGHTS, LEXICON, AO)
CONTENTS = {
    "deep": text(200_000 * "["),
    "not utf-8": text(b'{"a": "\xff\xfe"}'),
    "folder": folder,
    "loop": loop,
    "cut": cut(0.5),
    "list": text("[]"),
    "pipe": pipe,
}
IN_EVERY_FILE = ("cut", "list", "pipe")

NAN = math.nan
OBJECT = ("object_instances", 0)
TOP = ("user_defined", RECEPTACLE)

# File, place in it, values that it does not take, words of the message.
VALUES = (
    # Each kind of value, once with all that it does not take
    (SCENE, (*OBJECT, "translation"), ([1, 2], [1, "2", 3], [1, NAN, 3]), "translation is"),
    (SCENE, (*OBJECT, "translation"), ([1, 1e9, 3], [1, 10**400, 3], [True, 1, 1], None), "tran"),
    (SCENE, (*OBJECT, "rotation"), ([0, 0, 0, 0], [1, 0, 0]), "object_instances[0].rotation"),
    (SCENE, (*OBJECT, "uniform_scale"), (NAN, 0, "big", 1e9), "[0].uniform_scale"),
    (SCENE, (*OBJECT, "template_name"), (GONE, 5, ""), "template_name"),
    (SCENE, (*OBJECT, "template_name"), ("tables",), "'table'"),
    (SCENE, (*OBJECT, "motion_type"), ("STATC",), "'STATIC'"),
    (SCENE, ("object_instances",), ({}, None), "object_instances is"),
    (SCENE, OBJECT, (3,), "object_instances[0] is 3"),
    (TABLE, ("mass",), (0, None), "mass is"),
    (TABLE, ("render_asset",), ("a\0b", "a" * 5000), "render_asset"),
    (TABLE, ("render_asset",), (".",), "a folder"),
    (TABLE, ("friction_coefficient",), (-1,), "friction_coefficient"),
    (TABLE, ("semantic_id",), ("table", 2.5), "semantic_id"),
    (TABLE, ("up",), ([0, 0, 0],), "up is [0, 0, 0]"),
    (CUBE, ("use_bounding_box_for_collision",), (1,), "true or false"),
    # Each other field that has to be a name or in order
    (SCENE, ("articulated_object_instances", 0, "template_name"), ("chst",), "'chest'"),
    (SCENE, ("stage_instance",), (GONE,), "stage_instance"),
    (SCENE, ("default_lighting",), ("lighting/sum",), "'sun'"),
    (TABLE, ("user_defined", "category"), (4,), "category is 4"),
    (TABLE, (*TOP, "position"), (GONE,), "position"),
    (TABLE, (*TOP, "scale"), ([0.5, 0, 0.3],), "scale"),
    (AO, ("user_defined", "receptacle_aabb_in", "parent_link"), ("x",), "/x"),
    (STAGE, ("render_asset",), ("../../objects",), "render_asset"),
    (LIGHTS, ("lights", "a", "intensity"), (math.inf,), "lights.a.intensity"),
    (LEXICON, ("classes", 0, "id"), ("3",), "classes[0].id is '3'"),
    (CONFIG, ("stages",), ([], {"paths": []}), "stages"),
    (CONFIG, ("objects",), ({"paths": {".json": [3]}}, {"paths": {".json": "a"}}), "objects.paths"),
    (CONFIG, ("scene_instances",), ({"paths": {".json": [""]}},), "paths"),
)


def test_a_file_that_is_no_json_object_is_named(tmp_path):
    cases = {f"{SCENE} {content}": (SCENE, content) for content in CONTENTS}
    cases |= {f"{file} {content}": (file, content) for file in FILES for content in IN_EVERY_FILE}

    def check(case):
        file, content = case
        refused_with(tmp_path, file, CONTENTS[content], file.rpartition("/")[2])

    check_each(cases, check)


def test_a_value_that_makes_no_sense_is_named(tmp_path):
    def check(case):
        file, keys, value, words = case
        refused_with(tmp_path, file, put(*keys, value=value), file.rpartition("/")[2], words)

    cases = [(file, keys, v, words) for file, keys, values, words in VALUES for v in values]
    check_each({repr(case[:3])[:120]: case for case in cases}, check)


BOX = 'size="0.4 0.3, 0.2"'
MASS = '<mass value="5"/>'
ORIGIN = '<origin xyz="0.3, 0, 0"/>'
AXIS = '<axis xyz="1, 0, 0"/>'
ENDS = '<parent link="body"/><child link="drawer"/>'
END = "</robot>"
SECOND_JOINT = f'<joint name="again" type="fixed">{ENDS}</joint></robot>'

URDFS: dict[str, tuple[Damage, str]] = {
    "empty": (text(""), "not a valid URDF"),
    "deep": (text("<robot>" + 20_000 * "<a>" + 20_000 * "</a>" + "</robot>"), "nested"),
    "folder": (folder, "a folder"),
    "no link": (text("<robot/>"), "no link"),
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

    check_each(URDFS, check)


def chests(tmp_path, count, step_m):
    """A dataset whose layout has chests in a row."""
    root = whole_dataset(Path(tempfile.mkdtemp(dir=tmp_path)) / "data")
    chest = {"template_name": "chest"}
    row = [chest | {"translation": [step_m * number, 0.2, 5.0]} for number in range(count)]
    write_scene(root, tiny_scene() | {"articulated_object_instances": row})
    return root


def test_too_much_furniture_and_furniture_in_the_place_of_its_twin_is_refused(tmp_path):
    most = chests(tmp_path, MOST_FURNITURE, 1.5)
    assert len(read_as_env(most).articulations) == MOST_FURNITURE
    words = (f"{MOST_FURNITURE + 1} articulated_object_instances", f"at most {MOST_FURNITURE}")
    refused_everywhere(chests(tmp_path, MOST_FURNITURE + 1, 1.5), "scene_instance.json", *words)
    words = ("articulated_object_instances[1]", "chest stands where")
    refused_everywhere(chests(tmp_path, 2, 1e-5), "scene_instance.json", *words)
