"""Wild layouts: varied positions of furniture, and feasible tasks."""

import numpy as np
import pytest
from hab_authoring.layouts.checks import check_layout, free_range
from hab_authoring.layouts.overlaps import bodies_of
from hab_authoring.layouts.report import layout_faults
from hab_authoring.layouts.wild import NARROW_SHELVES, SPACING_M, WildConfig, WildVarier
from hab_authoring.pipeline.jobs import AssetOptions
from hab_authoring.pipeline.optimise import optimise
from refusals import refused_by_call, refused_by_command

from hab_tasks.articulations import FRIDGES
from hab_tasks.cli import main
from hab_tasks.episodes import EpisodeRequest, open_source
from hab_tasks.registration import ENTRY_POINTS
from hab_tasks.world.scenes.fields import read_json
from hab_tasks.world.scenes.habitat.dataset import SceneDataset, resolve_dataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.layout_geometry import Layout

COUNT = 2


def command(dataset, out, count=COUNT, *more):
    return ["vary", str(dataset), "--wild", "--count", str(count), "--out", str(out), *more]


@pytest.fixture(scope="module")
def wild(tmp_path_factory) -> SceneDataset:
    out = tmp_path_factory.mktemp("wild") / "layouts"
    assert main(command("apartment", out)) == 0
    return SceneDataset(out)


@pytest.fixture(scope="module")
def real(tmp_path_factory, replica_cad) -> SceneDataset:
    out = tmp_path_factory.mktemp("real") / "layouts"
    assert main(command(replica_cad, out, 5)) == 0
    return SceneDataset(out)


def fridge_of(spec):
    return next(a for a in spec.articulations if a.template in FRIDGES)


def hinge_limit(spec):
    """How far the fridge's upper door opens [rad]."""
    layout = Layout.of(spec)
    hinge = next(j for j in layout.joints if j.name == "top_door_hinge")
    return free_range(hinge, bodies_of(layout), 0.01).upper


def test_kitchen_and_furniture_move_to_where_tasks_can_be_done_and_all_else_stays(wild):
    for scene_id in wild.scene_files:
        old = load_scene(wild.source, wild.layouts.macros[scene_id])
        new = load_scene(wild, scene_id)
        shift = np.subtract(fridge_of(new).world_from_root[:2], fridge_of(old).world_from_root[:2])
        assert np.linalg.norm(shift) > 0.1
        before = {o.name: o.world_from_object for o in old.objects}
        after = {o.name: o.world_from_object for o in new.objects}
        assert before.keys() == after.keys()
        assert sum(before[n] != after[n] for n in before) >= 10
        stays = [o.name for o in old.objects if o.template.category in ("rug", "mat", "picture")]
        assert stays
        assert all(np.allclose(before[n], after[n], atol=1e-6) for n in stays)
        assert check_layout(wild, scene_id).reasons == ()
        assert hinge_limit(new) >= 1.6
    # A layout depends on its seed and number only.
    last = WildVarier(wild.source).make(0, COUNT)
    assert last.scene == read_json(wild.scene_file(max(wild.scene_files)))


def test_only_the_narrow_shelves_and_what_stands_on_them_hang_higher_where_asked(wild):
    plain = read_json(wild.scene_file(min(wild.scene_files)))["object_instances"]
    varier = WildVarier(wild.source, config=WildConfig(shelves_m=SPACING_M))
    raised = varier.make(0, 1).scene["object_instances"]
    lifts_m = {}
    for before, after in zip(plain, raised, strict=True):
        shift_m = np.subtract(after["translation"], before["translation"])
        assert np.allclose(shift_m[[0, 2]], 0.0, atol=1e-6)
        assert before["rotation"] == after["rotation"]
        if shift_m[1] != 0.0:
            lifts_m[after["template_name"]] = shift_m[1]
    assert any(NARROW_SHELVES in name for name in lifts_m)
    assert np.ptp(list(lifts_m.values())) < 1e-5
    assert 0.0 < min(lifts_m.values()) <= SPACING_M


def test_the_folder_is_a_dataset_of_its_own_whose_layouts_take_turns(wild):
    assert wild.name == "apartment_wild_0"
    assert wild.resolve_split(None) == "test"
    assert wild.scenes_of_split("test") == sorted(wild.scene_files)
    assert wild.scenes_of_split("train") == []
    assert wild.fingerprint != wild.source.fingerprint
    source = open_source(EpisodeRequest(env_id="HabCloseFridge-v1", scene_dataset=wild.root))
    made = [source.make(index).episode.scene_id for index in range(COUNT + 1)]
    assert made == [*sorted(wild.scene_files), min(wild.scene_files)]


def test_layouts_of_one_macro_layout_are_a_dataset_of_its_split(tmp_path):
    out = tmp_path / "varied"
    assert main(["vary", "apartment", "--macro", "sc3", "--count", "1", "--out", str(out)]) == 0
    made = resolve_dataset(out)
    assert made.name == "apartment_sc3_0"
    # sc3 is the macro layout of split val.
    assert made.scenes_of_split("val") == ["v3_sc3_staging_01"]
    assert load_scene(made, "v3_sc3_staging_01").dataset == "apartment_sc3_0"


def test_bad_commands_are_told(wild, tmp_path):
    out = tmp_path / "a"
    refused_by_command(main, command(wild.root, out), "vary apartment")
    extended = command("apartment", out, 1, "--extend", "train")
    refused_by_command(main, [*extended[:-1], "trian"], "trian")
    refused_by_command(main, [*extended, "--macro", "sc0"], "--extend samples wild layouts")
    ordinary = ["vary", "apartment", "--macro", "sc0", "--corner", "--out", str(out)]
    refused_by_command(main, ordinary, "--corner puts fridges of wild layouts")
    ordinary[ordinary.index("--corner")] = "--shelves"
    refused_by_command(main, ordinary, "--shelves raises the shelves of wild layouts")
    refused_by_call(lambda: optimise(wild, out, AssetOptions()), "layouts only")
    assert not out.exists()


@pytest.mark.slow
@pytest.mark.assets
def test_real_layouts_keep_to_what_tasks_need(real):
    reached = []
    for scene_id in sorted(real.scene_files):
        faults = [f for f in layout_faults(real, scene_id) if not f.startswith("overlap")]
        assert faults == [], scene_id
        reached.append(hinge_limit(load_scene(real, scene_id)))
    assert min(reached) >= 1.6
    assert sum(upper < 2.29 for upper in reached) >= 2


@pytest.mark.parametrize(
    ("which", "envs"),
    [
        pytest.param("wild", ("HabPick-v1", "HabSetTable-v1"), marks=pytest.mark.slow),
        pytest.param("real", ENTRY_POINTS, marks=[pytest.mark.long, pytest.mark.assets]),
    ],
    ids=["wild", "real"],
)
def test_every_layout_gives_episodes(which, envs, request):
    dataset = request.getfixturevalue(which)
    for env in envs:
        for scene_id in sorted(dataset.scene_files)[:COUNT]:
            asked = EpisodeRequest(env_id=env, scene_dataset=str(dataset.root), scene=scene_id)
            assert open_source(asked).make(0).episode.scene_id == scene_id


def test_layouts_extend_a_split_of_their_dataset(tmp_path):
    out = tmp_path / "larger"
    assert main(command("apartment", out, 2, "--extend", "train")) == 0
    apartment, larger = resolve_dataset("apartment"), SceneDataset(out)
    added = set(larger.layouts.macros)
    assert len(added) == 2
    assert set(larger.layouts.macros.values()) <= {f"v3_sc{n}_staging_00" for n in range(3)}
    assert set(larger.scenes_of_split("train")) == added | set(apartment.scenes_of_split("train"))
    for split in ("val", "test"):
        assert larger.scenes_of_split(split) == apartment.scenes_of_split(split)
    first, again = (load_scene(dataset, "v3_sc3_staging_00") for dataset in (apartment, larger))
    assert first.objects == again.objects
    asked = EpisodeRequest(env_id="HabNavigate-v1", scene_dataset=str(out), split="train")
    source = open_source(asked)
    assert {source.get(index).scene_id for index in range(2)} == added
