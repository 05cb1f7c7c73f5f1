"""Suite sim: steps/s of each environment with state observations, compared with ManiSkill."""

from __future__ import annotations

from hab_eval.bench.comparison import alternate, hab_env, motions, reference, step_rows
from hab_eval.bench.options import BenchOptions
from hab_eval.bench.rows import BenchRow
from hab_eval.bench.suite import DENSE_SCENE, FIRST_SCENE, Suite, WriteLine
from hab_tasks.envs import ENVS


def run_sim(options: BenchOptions, write_line: WriteLine) -> list[BenchRow]:
    """Measures each environment with state observations in each scene."""
    every = tuple(ENVS)
    rows: list[BenchRow] = []
    for (scene,) in options.groups:
        with reference(options, (scene,), obs_mode="state") as reference_env:
            for env_id in options.envs_in(scene, every):
                with hab_env(options, env_id, (scene,), obs_mode="state_dict") as env:
                    write_line(f"suite sim, scene {scene}, {env_id}: both environments are ready")
                    control, motion = motions(env_id)
                    pairs = alternate(options, motion, env, reference_env, write_line)
                    rows += step_rows(("sim", scene, env_id, control), pairs)
    return rows


SUITE = Suite(
    name="sim",
    run=run_sim,
    steps=200,
    groups=((FIRST_SCENE,), (DENSE_SCENE,)),
    takes_envs=True,
)
