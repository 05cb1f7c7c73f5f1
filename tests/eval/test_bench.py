import json
import os
from dataclasses import replace

import pytest
import stub_bench
import torch
from hab_eval.bench.comparison import step_rows
from hab_eval.bench.layout import LAYOUT, make_layout, scene_ids
from hab_eval.bench.motion import BASE_SPEEDS, Motion
from hab_eval.bench.options import BenchOptions
from hab_eval.bench.process import QUIET_STEPS, RemoteEnv, StepTiming, time_steps
from hab_eval.bench.report import make_report, read_report, report_table, write_report
from hab_eval.bench.rows import BenchRow, bound_row, make_row
from hab_eval.bench.suite import PICK
from hab_eval.bench.suites import find_suite, run_suite
from hab_eval.errors import BenchError

from hab_tasks.errors import FileError, OptionError, UnknownNameError


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
    name = ("sim", "apt_0", "HabPick-v1", "ee")
    speed, share, engine = step_rows(name, [(ours, theirs)] * 5)
    assert speed.name == "sim/apt_0/HabPick-v1/ee"
    assert (speed.value, speed.ratio, speed.n) == (400.0, 2.0, 5)
    assert share.name == "sim/apt_0/HabPick-v1/ee_physics_share"
    assert (share.value, share.reference_value) == pytest.approx((0.2, 0.1))
    assert (engine.value, engine.ratio) == pytest.approx((0.5, 1.0))
    # The rest of the step: 0.4 s in 200 steps.
    assert ours.outside_ms == pytest.approx(2.0)


def test_a_bound_is_a_reference_too():
    # The median of 30, 10 and 20 is 20, half of the bound.
    row = bound_row(("a", "b", "c", "d"), [30.0, 10.0, 20.0], 40.0, unit="MB")
    assert (row.value, row.reference, row.reference_value, row.ratio, row.n) == (
        20.0,
        "bound",
        40.0,
        0.5,
        3,
    )


def test_report_file(tmp_path):
    row = make_row(("sim", "b", "c", "d"), [2.0], [1.0], unit="ms")
    path = tmp_path / "new" / "sim.json"
    report = make_report("sim", [row])
    write_report(path, report, force=False)
    assert read_report(path) == report
    assert {"hab-tasks", "sapien", "python"} <= report.versions.keys()
    with pytest.raises(FileError, match="--force"):
        write_report(path, report, force=False)
    write_report(path, make_report("sim", []), force=True)
    assert read_report(path).rows == ()


def test_a_table_of_a_report_by_hand():
    rows = [
        make_row(("sim", "apt", "HabPick-v1", "ee"), [1134.6], [250.0], unit="steps/s"),
        bound_row(("sim", "apt", "HabPick-v1", "share"), [0.4561], 0.5, unit="1"),
    ]
    report = replace(
        make_report("sim", rows), git="0123456789abcdef", date="2026-01-31", device="CPU, 2 cores"
    )
    assert report_table(report, "1") == (
        "Commit 0123456789ab, 2026-01-31, CPU, 2 cores. Reference: bound.\n\n"
        "|  | here | reference | ratio | unit |\n"
        "| --- | --- | --- | --- | --- |\n"
        "| apt/HabPick-v1/share | 0.456 | 0.5 | 0.912 | 1 |\n"
    )
    # 1134.6 / 250 = 4.538
    assert "| apt/HabPick-v1/ee | 1135 | 250 | 4.54 | steps/s |" in report_table(report)


def test_both_sides_get_the_same_small_motion():
    both = Motion(count=50, seed=3, base=True)
    assert torch.equal(both.arm_steps_m(), Motion(count=50, seed=3).arm_steps_m())
    assert not torch.equal(both.arm_steps_m(), Motion(count=50, seed=4).arm_steps_m())
    assert 0.01 < both.arm_steps_m().abs().max() <= 0.015
    assert both.base_speeds().shape == (50, 2)
    assert (both.base_speeds().abs() <= torch.tensor(BASE_SPEEDS)).all()
    assert not torch.equal(both.base_speeds()[:, 0] / 0.2, both.base_speeds()[:, 1] / 0.6)


def test_what_does_not_move_stands_still():
    assert not Motion(count=5, seed=3).base_speeds().any()
    base = Motion(count=5, seed=3, arm=False, base=True)
    assert not base.arm_steps_m().any()
    assert base.base_speeds().all()


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


@pytest.mark.slow
def test_side_in_a_process_of_its_own():
    env = RemoteEnv(stub_bench.Factory(), {"STUB_RESET_S": "0.125"})
    try:
        assert "STUB_RESET_S" not in os.environ
        assert env.soft_reset() == 0.125
        assert env.run_steps(Motion(count=3, seed=1)).steps == 3
        with pytest.raises(BenchError, match="ZeroDivisionError: no other scene"):
            env.other_layout()
    finally:
        env.close()
    with pytest.raises(BenchError, match="exit code 7"):
        RemoteEnv(stub_bench.DyingFactory(), {})


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
    options = BenchOptions(suite=find_suite("sim"), scene_dataset=dataset, scenes=("on",))
    with pytest.raises(UnknownNameError, match="Did you mean 'one'"):
        run_suite(options, lambda line: None)
    with pytest.raises(BenchError, match="not a ReplicaCAD folder"):
        run_suite(
            BenchOptions(suite=find_suite("sim"), scene_dataset=dataset / "x"), lambda line: None
        )


def test_environments_are_checked_before_anything_starts(stubbed, dataset):
    options = BenchOptions(
        suite=find_suite("sim"), scene_dataset=dataset, scenes=("one",), envs=("HabStab-v1",)
    )
    with pytest.raises(UnknownNameError, match="Did you mean 'HabStub-v1'"):
        run_suite(options, lambda line: None)


def test_every_environment_in_the_first_scene_and_pick_in_the_others(tmp_path):
    every = (PICK, "HabPlace-v1")
    default = BenchOptions(suite=find_suite("sim"), scene_dataset=tmp_path)
    assert default.groups == (("v3_sc0_staging_00",), ("apt_0",))
    assert [default.envs_in(scene, every) for (scene,) in default.groups] == [every, (PICK,)]
    asked = BenchOptions(
        suite=find_suite("sim"), scene_dataset=tmp_path, scenes=("a", "b"), envs=("HabPlace-v1",)
    )
    assert [asked.envs_in(scene, every) for (scene,) in asked.groups] == [("HabPlace-v1",)] * 2
    with pytest.raises(OptionError, match="does not support --env"):
        BenchOptions(suite=find_suite("memory"), scene_dataset=tmp_path, envs=(PICK,))
    assert BenchOptions(suite=find_suite("memory"), scene_dataset=tmp_path).groups == (
        ("v3_sc0_staging_00",),
    )


def test_bench_command_names_what_is_wrong(cli, dataset, tmp_path):
    target = tmp_path / "rows.json"
    common = ("--scene-dataset", dataset, "--json", target)
    assert "Did you mean 'sim'?" in cli("bench", "--suite", "sims", *common).stderr
    # Each may be given several times, and none of them is lost.
    for scenes in (("onee", "one"), ("one", "onee")):
        given = [word for scene in scenes for word in ("--scene", scene)]
        unknown = cli("bench", "--suite", "sim", *common, *given)
        assert unknown.returncode == 2
        assert "Did you mean 'one'?" in unknown.stderr
    env = cli("bench", "--suite", "sim", *common, "--scene", "one", "--env", "HabStab-v1")
    assert env.returncode == 2
    assert "Did you mean 'HabStub-v1'?" in env.stderr
    other = cli("bench", "--suite", "objects", *common, "--scene", "one", "--env", "HabStub-v1")
    assert other.returncode == 2
    assert "does not support --env" in other.stderr
    assert cli("bench", "--suite", "sim", *common, "--repeats", 0).returncode == 2
    alone = cli("bench", "--suite", "reset", *common, "--scene", "one")
    assert alone.returncode == 2
    assert "--scene at least twice" in alone.stderr
    target.write_text("[]")
    taken = cli("bench", "--suite", "sim", *common)
    assert taken.returncode == 2
    assert "--force" in taken.stderr


def test_default_scenes_are_measured_in_their_order():
    first, second = find_suite("reset").groups
    assert first[:3] == tuple(f"v3_sc{i}_staging_00" for i in range(3))
    assert second == ("apt_0", "apt_1", "apt_2")
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
    from hab_eval.bench.reference import ReferenceFactory

    before = snapshot(replica_cad)
    scenes = ("v3_sc0_staging_00", "apt_0")
    make_layout(replica_cad, scenes, tmp_path)
    factory = ReferenceFactory(scenes=scenes, obs_mode="state")
    env = RemoteEnv(factory, {"MS_ASSET_DIR": str(tmp_path)})
    try:
        timing = env.run_steps(Motion(count=30, seed=0, base=True))
        assert timing.steps_per_s > 10
        assert 0.01 < timing.physics_share < 0.9
        assert env.soft_reset() < 1.0
        assert env.other_layout() > 0.0
    finally:
        env.close()
    assert snapshot(replica_cad) == before
