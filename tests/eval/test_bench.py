import json
import time
from types import SimpleNamespace

import pytest
import torch
from hab_eval.bench.comparison import step_rows
from hab_eval.bench.process import QUIET_STEPS, Motion, RemoteEnv, StepTiming, time_steps
from hab_eval.bench.reference import make_layout
from hab_eval.bench.report import (
    bound_row,
    make_report,
    make_row,
    read_report,
    report_table,
    write_report,
)
from hab_eval.errors import BenchError
from refusals import check_each


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


def test_rows_by_hand():
    # 200 steps in 0.5 s, of which 0.1 s in the engine: 400 steps/s, share 0.2, 0.5 ms a step.
    ours = StepTiming(steps=200, total_s=0.5, engine_s=0.1)
    # 200 steps in 1 s, of which 0.1 s in the engine: 200 steps/s, share 0.1, 0.5 ms a step.
    theirs = StepTiming(steps=200, total_s=1.0, engine_s=0.1)
    name = ("sim", "apt_0", "HabPick-v1", "ee")
    speed, share, engine = step_rows(name, [(ours, theirs)] * 5)
    assert (speed.name, speed.n) == ("sim/apt_0/HabPick-v1/ee", 5)
    assert (speed.value, speed.ratio) == (400.0, 2.0)
    assert (share.value, share.reference_value) == pytest.approx((0.2, 0.1))
    assert (engine.value, engine.ratio) == pytest.approx((0.5, 1.0))
    # The rest of the step: 0.4 s in 200 steps.
    assert ours.outside_ms == pytest.approx(2.0)
    # Medians 100 and 40.
    row = make_row(name, [90.0, 100.0, 500.0], [40.0, 50.0, 1.0], unit="steps/s")
    assert (row.value, row.reference_value, row.ratio, row.n) == (100.0, 40.0, 2.5, 3)
    # The median of 30, 10 and 20 is 20, half of the bound.
    row = bound_row(name, [30.0, 10.0, 20.0], 40.0, unit="MB")
    assert (row.value, row.reference, row.reference_value, row.ratio) == (20.0, "bound", 40.0, 0.5)


def test_report_file(tmp_path):
    row = make_row(("sim", "b", "c", "d"), [2.0], [1.0], unit="ms")
    path = tmp_path / "new" / "sim.json"
    report = make_report("sim", [row])
    write_report(path, report, force=False)
    assert read_report(path) == report
    assert {"hab-tasks", "sapien", "python"} <= report.versions.keys()
    # 2 / 1
    assert "| b/c/d | 2 | 1 | 2 | ms |" in report_table(report)


class Engine:
    __slots__ = ()  # cannot be patched, like SAPIEN's engine

    timestep = 1 / 120

    def step(self):
        time.sleep(0.002)


class Env:
    """Sleeps half of its step inside the engine."""

    def __init__(self, *, uses_engine=True):
        self.scene, self.unwrapped = SimpleNamespace(px=Engine()), self
        self.actions = []
        self._uses_engine = uses_engine

    def step(self, action):
        self.actions.append(action)
        time.sleep(0.002)
        if self._uses_engine:
            assert self.scene.px.timestep == 1 / 120
            self.scene.px.step()


def test_engine_is_timed_inside_the_same_steps():
    env = Env()
    engine = env.scene.px
    timing = time_steps(env, torch.zeros(2), torch.ones(20, 2))
    assert timing.steps == 20
    # Two equal sleeps; a busy machine stretches both.
    assert 0.3 < timing.physics_share < 0.7
    assert timing.total_s >= 20 * 0.004
    assert env.scene.px is engine
    quiet, timed = env.actions[:QUIET_STEPS], env.actions[QUIET_STEPS:]
    assert all(not action.any() for action in quiet)
    assert [action.shape for action in timed] == [(1, 2)] * 20
    with pytest.raises(BenchError, match=r"scene\.px"):  # an engine that is not seen
        time_steps(Env(uses_engine=False), torch.zeros(2), torch.ones(1, 2))


SIM = ("--suite", "sim")
REFUSED = (
    (("--suite", "sims"), "Did you mean 'sim'?"),
    # Each may be given several times, and none of them is lost.
    ((*SIM, "--scene", "onee", "--scene", "one"), "Did you mean 'one'?"),
    ((*SIM, "--scene", "one", "--env", "HabStab-v1"), "Did you mean 'HabStub-v1'?"),
    (("--suite", "regressions", "--scene", "one", "--env", "HabStub-v1"), "does not support --env"),
    (("--suite", "reset", "--scene", "one"), "--scene at least twice"),
    ((*SIM, "--scene-dataset", "x"), "not a ReplicaCAD folder"),
    ((*SIM, "--json", "taken.json"), "--force"),
)


def test_bench_command_names_what_is_wrong(cli, dataset, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken.json").write_text("[]")

    def check(case):
        arguments, message = case
        usual = {"--scene-dataset": dataset, "--json": "rows.json"}
        more = [word for key in usual if key not in arguments for word in (key, usual[key])]
        done = cli("bench", *arguments, *more)
        assert done.returncode == 2
        assert message in done.stderr

    check_each({str(case[0]): case for case in REFUSED}, check)


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
