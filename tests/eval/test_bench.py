import json
import os

import pytest
import stub_bench
import torch
from hab_eval.bench import BenchOptions, BenchRow, make_row, run_suite, step_rows, write_rows
from hab_eval.bench_layout import LAYOUT, make_layout, scene_ids
from hab_eval.bench_process import (
    QUIET_STEPS,
    RemoteSide,
    StepTiming,
    arm_steps_m,
    time_steps,
)
from hab_eval.errors import BenchError

from hab_tasks.errors import UnknownNameError


@pytest.fixture
def dataset(tmp_path):
    """A ReplicaCAD of one scene, in Facebook's layout, with its defects."""
    root = tmp_path / "replica"
    for folder in ("objects", "configs/scenes", "configs/objects", "urdf/kitchen_cupboards"):
        (root / folder).mkdir(parents=True)
    scene = {
        "stage_instance": {"template_name": "stages/absent_stage"},
        "object_instances": [{"template_name": "objects/bike"}],
        "articulated_object_instances": [{"template_name": "kitchenCupboard_01"}],
    }
    (root / "configs/scenes/one.scene_instance.json").write_text(json.dumps(scene))
    bike = {"render_asset": "../../objects/bike.glb"}
    (root / "configs/objects/bike.object_config.json").write_text(json.dumps(bike))
    cupboard = '<box size="0.6 0.1, 0.9"/><mesh filename="a,b.glb" scale="1, 1, 1"/>'
    (root / "urdf/kitchen_cupboards/kitchenCupboard_01.urdf").write_text(cupboard)
    return root


def snapshot(folder):
    return {path: path.stat().st_mtime_ns for path in sorted(folder.rglob("*"))}


def test_row_is_the_ratio_of_medians():
    name = ("sim", "v3_sc0_staging_00", "HabPick-v1", "ee")
    row = make_row(name, [90.0, 100.0, 500.0], [40.0, 50.0, 1.0], unit="steps/s")
    assert row.name == "sim/v3_sc0_staging_00/HabPick-v1/ee"
    # Medians 100 and 40.
    assert (row.value, row.reference_value, row.ratio, row.n) == (100.0, 40.0, 2.5, 3)


def test_step_rows():
    # 200 steps in 0.5 s, of which 0.1 s in the engine: 400 steps/s, share 0.2, 0.5 ms a step.
    ours = StepTiming(steps=200, total_s=0.5, engine_s=0.1)
    # 200 steps in 1 s, of which 0.1 s in the engine: 200 steps/s, share 0.1, 0.5 ms a step.
    theirs = StepTiming(steps=200, total_s=1.0, engine_s=0.1)
    speed, share, engine = step_rows("sim", "apt_0", [(ours, theirs)] * 5)
    assert speed.name == "sim/apt_0/HabPick-v1/ee"
    assert (speed.value, speed.ratio, speed.n) == (400.0, 2.0, 5)
    assert share.name == "sim/apt_0/HabPick-v1/ee_physics_share"
    assert (share.value, share.reference_value) == pytest.approx((0.2, 0.1))
    assert (engine.value, engine.ratio) == pytest.approx((0.5, 1.0))
    (depth,) = step_rows("depth", "apt_0", [(ours, theirs)])
    assert depth.name == "depth/apt_0/HabPick-v1/two_cameras"


def test_rows_file(tmp_path):
    row = make_row(("a", "b", "c", "d"), [2.0], [1.0], unit="ms")
    path = tmp_path / "new" / "rows.json"
    write_rows(path, [row], force=False)
    keys = {"name", "value", "unit", "reference", "reference_value", "ratio", "n"}
    assert [set(entry) for entry in json.loads(path.read_text())] == [keys]
    with pytest.raises(BenchError, match="--force"):
        write_rows(path, [row], force=False)
    write_rows(path, [], force=True)
    assert json.loads(path.read_text()) == []


def test_both_sides_get_the_same_small_motion():
    assert torch.equal(arm_steps_m(50, 3), arm_steps_m(50, 3))
    assert not torch.equal(arm_steps_m(50, 3), arm_steps_m(50, 4))
    assert arm_steps_m(50, 3).abs().max() <= 0.015


def test_engine_is_timed_inside_the_same_steps():
    env = stub_bench.Env()
    engine = env.scene.px
    timing = time_steps(env, torch.zeros(2), torch.ones(20, 2))
    assert timing.steps == 20
    # Two equal sleeps; a busy machine stretches both.
    assert 0.3 < timing.physics_share < 0.7
    assert timing.total_s >= 20 * (stub_bench.ENGINE_S + stub_bench.OTHER_S)
    assert env.scene.px is engine
    quiet, timed = env.actions[:QUIET_STEPS], env.actions[QUIET_STEPS:]
    assert all(not action.any() for action in quiet)
    assert len(timed) == 20
    assert all(action.shape == (1, 2) for action in timed)


def test_engine_that_is_not_seen_is_an_error():
    env = stub_bench.Env(uses_engine=False)
    with pytest.raises(BenchError, match=r"scene\.px"):
        time_steps(env, torch.zeros(2), torch.ones(1, 2))


def test_side_in_a_process_of_its_own():
    side = RemoteSide(stub_bench.Factory(), {"STUB_RESET_S": "0.125"})
    try:
        assert "STUB_RESET_S" not in os.environ
        assert side.soft_reset() == 0.125
        assert side.run_steps(3, seed=1).steps == 3
        with pytest.raises(BenchError, match="ZeroDivisionError: no other scene"):
            side.other_layout()
    finally:
        side.close()
    with pytest.raises(BenchError, match="exit code 7"):
        RemoteSide(stub_bench.DyingFactory(), {})


def test_layout_for_maniskill(dataset, tmp_path):
    before = snapshot(dataset)
    make_layout(dataset, ["one"], tmp_path / "assets")
    target = tmp_path / "assets" / LAYOUT
    urdf = (target / "urdf/kitchenCupboard_01/kitchenCupboard_01.urdf").read_text()
    assert 'size="0.6 0.1  0.9"' in urdf
    assert 'scale="1  1  1"' in urdf
    assert "a,b.glb" in urdf  # a file name is no list of numbers
    for stand_in in ("stages/absent_stage.glb", "objects/bike.glb"):
        assert (target / stand_in).stat().st_size > 0
    assert not any(path.is_symlink() for path in target.rglob("*"))
    assert snapshot(dataset) == before


def test_scenes_are_checked_before_anything_starts(dataset):
    assert scene_ids(dataset) == ["one"]
    options = BenchOptions(suite="sim", scene_dataset=dataset, scenes=("on",))
    with pytest.raises(UnknownNameError, match="Did you mean 'one'"):
        run_suite(options, lambda line: None)
    with pytest.raises(BenchError, match="no ReplicaCAD folder"):
        run_suite(BenchOptions(suite="sim", scene_dataset=dataset / "x"), lambda line: None)


def test_bench_command_names_what_is_wrong(cli, dataset, tmp_path):
    target = tmp_path / "rows.json"
    common = ("--scene-dataset", dataset, "--json", target)
    assert cli("bench", "--suite", "sims", *common).returncode == 2
    unknown = cli("bench", "--suite", "sim", *common, "--scene", "onee")
    assert unknown.returncode == 2
    assert "Did you mean 'one'?" in unknown.stderr
    assert cli("bench", "--suite", "sim", *common, "--repeats", 0).returncode == 2
    alone = cli("bench", "--suite", "reset", *common, "--scene", "one")
    assert alone.returncode == 2
    assert "--scene twice" in alone.stderr
    target.write_text("[]")
    taken = cli("bench", "--suite", "sim", *common)
    assert taken.returncode == 2
    assert "--force" in taken.stderr


def test_default_scenes_are_measured_in_their_order(monkeypatch, dataset):
    from hab_eval import bench

    assert bench.DEFAULT_SCENES == ("v3_sc0_staging_00", "apt_0")
    assert bench.RESET_SCENES[0][:3] == tuple(f"v3_sc{i}_staging_00" for i in range(3))
    assert bench.RESET_SCENES[1] == ("apt_0", "apt_1", "apt_2")
    assert BenchRow.__dataclass_fields__.keys() == {
        "name",
        "value",
        "unit",
        "reference",
        "reference_value",
        "ratio",
        "n",
    }


@pytest.mark.slow
@pytest.mark.assets
@pytest.mark.render
def test_maniskill_runs_in_the_real_scene_and_writes_nothing_there(tmp_path, replica_cad):
    from hab_eval.bench_reference import ReferenceFactory

    before = snapshot(replica_cad)
    scenes = ("v3_sc0_staging_00", "apt_0")
    make_layout(replica_cad, scenes, tmp_path)
    factory = ReferenceFactory(scenes=scenes, obs_mode="state")
    side = RemoteSide(factory, {"MS_ASSET_DIR": str(tmp_path)})
    try:
        timing = side.run_steps(30, seed=0)
        assert timing.steps_per_s > 10
        assert 0.01 < timing.physics_share < 0.9
        assert side.soft_reset() < 1.0
        assert side.other_layout() > 0.0
    finally:
        side.close()
    assert snapshot(replica_cad) == before
