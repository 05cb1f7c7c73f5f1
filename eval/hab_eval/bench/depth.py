"""Suite depth: steps/s of HabPick-v1 with two depth cameras, compared with ManiSkill."""

from __future__ import annotations

from hab_eval.bench.comparison import alternate, hab_env, motions, reference, step_rows
from hab_eval.bench.options import BenchOptions
from hab_eval.bench.rows import BenchRow
from hab_eval.bench.suite import DENSE_SCENE, FIRST_SCENE, PICK, Suite, WriteLine


def run_depth(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures HabPick-v1 with two depth cameras in each scene."""
    rows: list[BenchRow] = []
    for (scene,) in options.groups:
        with (
            reference(options, (scene,), obs_mode="depth") as reference_env,
            hab_env(options, PICK, (scene,), obs_mode="depth", render_backend="cpu") as env,
        ):
            write_line(f"suite depth, scene {scene}: both environments are ready")
            _, motion = motions(PICK)
            pairs = alternate(options, motion, env, reference_env, write_line)
            rows += step_rows(("depth", scene, PICK, "two_cameras"), pairs)[:1]
    return rows


SUITE = Suite(name="depth", run=run_depth, steps=40, groups=((FIRST_SCENE,), (DENSE_SCENE,)))
