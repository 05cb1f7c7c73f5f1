"""Planted defects: each must be found by the tests (`make defects`)."""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]

TIERS = {"quick": ("slow", "long"), "slow": ("long",)}
"""Tier -> markers of the tests that it leaves out; slow is the tier of CI."""

BASELINES = ("experts", "navigator", "plans", "ppo", "spa", "tp_srl")
PACKAGES = ("", "eval", "assets/authoring", *(f"baselines/{name}" for name in BASELINES))

NOT_FOUND = "NOT FOUND"


@dataclass(frozen=True, kw_only=True)
class Defect:
    """A planted defect.

    Attributes:
        name: Its name.
        file: The file, relative to the repository.
        old: Text that occurs exactly once in the file.
        new: Text that replaces it.
        first: Tests that run first, relative to `tests`, separated by spaces.
        tier: Lowest tier of tests that finds it.
    """

    name: str
    file: str
    old: str
    new: str
    first: str
    tier: str = "quick"


# fmt: off
DEFECTS = (
    Defect(name="reward_sign", first="core/test_rewards_doors.py",
           file="hab_tasks/skills/close_drawer.py",
           old='"joint": -w.joint', new='"joint": w.joint'),
    Defect(name="success_radius", first="core/test_measures.py", file="hab_tasks/constants.py",
           old="PLACE_RADIUS_M = 0.15", new="PLACE_RADIUS_M = 0.2"),
    Defect(name="horizon", first="vector/test_vector_interface.py",
           file="hab_tasks/vector/outputs.py",
           old="steps[chosen] >= self._max_steps", new="steps[chosen] > self._max_steps"),
    Defect(name="target_frame", first="core/test_sensors.py", file="hab_tasks/engine/snapshot.py",
           old="cosine * x + sine * y, cosine * y - sine * x, points_m",
           new="cosine * x - sine * y, cosine * y + sine * x, points_m"),
    Defect(name="row_seed", first="vector/test_vector_rows.py", file="hab_tasks/vector/workers.py",
           old="options = message.seeds[row], ", new="options = None, "),
    Defect(name="contact_force", first="envs/test_pick_endings.py",
           file="hab_tasks/engine/snapshot.py",
           old="if not apart(bodies) and not self._is_grip(bodies):"
               "\n                for point",
           new="if self._links.issuperset(bodies):\n                for point"),
    Defect(name="gripper_mask", first="core/test_rewards_place.py",
           file="hab_tasks/skills/place.py",
           old="where(m.released | m.released_before,", new="where(m.released,"),
    Defect(name="closed_door", first="core/test_grasp.py", file="hab_tasks/robots/snap_grasp.py",
           old="enclosed is not None and enclosed[index]", new="False"),
    Defect(name="split", first="authoring/test_wild.py",
           file="hab_tasks/world/scenes/habitat/dataset.py",
           old='"val": ("sc3",), "test": ("sc4",)', new='"val": ("sc4",), "test": ("sc3",)'),
    Defect(name="wilson", first="eval/test_stats.py", file="eval/hab_eval/records/stats.py",
           old='method="wilson"', new='method="wilsoncc"'),
    Defect(name="no_rename", first="core/test_files.py", file="hab_tasks/io/files.py",
           old="            scratch.replace(target)",
           new="            shutil.copyfile(scratch, target)"),
    Defect(name="shared_memory", first="vector/test_shared_arrays.py",
           file="hab_tasks/io/shared_arrays.py",
           old="            os.close(self.file)\n            self.file = -1",
           new="            self.file = -1"),
    Defect(name="held_object", first="baselines/test_spa_collision.py",
           file="baselines/spa/hab_spa/planning/items.py",
           old='        return "held"', new='        return "robot"'),
    Defect(name="neighbour_row", first="core/test_tracker.py", file="hab_tasks/engine/measures.py",
           old="values[self._rows, column]", new="values[self._rows - 1, column]"),
    Defect(name="gae_time_out", first="baselines/ppo/test_ppo_data.py",
           file="baselines/ppo/hab_ppo/rollout.py",
           old="discount * ~rollout.terminated",
           new="discount * ~(rollout.terminated | rollout.truncated)"),
    Defect(name="quaternion_order", first="authoring/test_habitat_episodes.py",
           file="assets/authoring/hab_authoring/habitat/fields.py",
           old="qx, qy, qz, qw = (number", new="qw, qx, qy, qz = (number"),
    Defect(name="depth_scale", first="core/test_depth_scale.py", file="hab_tasks/engine/sensors.py",
           old="depth <= 0, torch.ones_like(depth)", new="depth <= 0, torch.zeros_like(depth)"),
    Defect(name="arm_camera", first="envs/test_render.py",
           file="hab_tasks/robots/fetch/__init__.py",
           old='"arm": CameraPlace(link="gripper_link"', new='"arm": CameraPlace(link="base_link"'),
    Defect(name="drawer_share", first="core/test_rewards_doors.py",
           file="hab_tasks/articulations.py",
           old="DRAWER_OPEN_SHARE = 0.9", new="DRAWER_OPEN_SHARE = 0.8"),
    Defect(name="fridge_closed", first="core/test_rewards_doors.py",
           file="hab_tasks/articulations.py",
           old="FRIDGE_CLOSED_RAD = 0.15", new="FRIDGE_CLOSED_RAD = 0.2"),
    Defect(name="rest_frame", first="envs/test_pick_endings.py",
           file="hab_tasks/engine/measures.py",
           old="s.ee_in_base_m - self.goals", new="s.ee_m - self.goals"),
    Defect(name="penalty_cap", first="core/test_rewards_pick.py",
           file="hab_tasks/engine/rules.py",
           old="-np.minimum(weight", new="-np.maximum(weight"),
    Defect(name="resume_twice", first="eval/test_run.py", file="eval/hab_eval/run/evaluate.py",
           old=" if job[1].id not in finished]", new="]"),
    Defect(name="verify_outcome", first="eval/test_submissions.py",
           file="eval/hab_eval/run/replay.py",
           old='("success", "failure", "stages", "steps")', new='("stages", "steps")'),
    Defect(name="precondition", first="baselines/test_planner.py",
           file="baselines/plans/hab_plans/domain.pddl",
           old="(in ?x ?z) (is-open ?z))", new="(in ?x ?z))"),
    Defect(name="early_hand_over", first="baselines/tp_srl/test_tp_srl_parts.py",
           file="baselines/tp_srl/hab_tp_srl/ending.py",
           old="return self._held and not view.holding", new="return self._held"),
    Defect(name="cache_key", first="core/test_shared_episodes.py",
           file="hab_tasks/episodes/source.py",
           old='{key:08x}/{self._name}"', new='{key:08x}/{self.env_id}.{kind}.{scope}.json.gz"'),
    Defect(name="moving_body", first="envs/test_rays.py", file="hab_tasks/engine/ray_sensors.py",
           old="entity=sapien_object(actor))", new="entity=sapien_object(actor), moves=False)"),
    Defect(name="shared_noise", first="core/test_noise.py", file="hab_tasks/engine/noise.py",
           old="(self._seed, self._step, stream)", new="(self._step, stream)"),
    Defect(name="clip_sign", first="baselines/ppo/test_ppo_update.py",
           file="baselines/ppo/hab_ppo/ppo.py",
           old="gains = torch.minimum(", new="gains = torch.maximum("),
)
# fmt: on


def misplaced(root: Path) -> list[str]:
    """Returns the names of the defects whose old text does not occur exactly once."""
    return [d.name for d in DEFECTS if (root / d.file).read_text().count(d.old) != 1]


class Copy:
    """A copy of a checkout in which tests run."""

    def __init__(self, checkout: Path, folder: Path, workers: int) -> None:
        """Copies the tracked files, as they are in the working tree."""
        self.folder, self.workers = folder / "copy", workers
        self._python = checkout / ".venv/bin/python"
        # A clone, since some tests ask git.
        subprocess.run(["git", "clone", "-q", checkout, self.folder], check=True)
        listed = subprocess.check_output(["git", "ls-files", "-z"], cwd=checkout, text=True)
        for name in filter(None, listed.split("\0")):
            source, target = checkout / name, self.folder / name
            if not source.exists():
                target.unlink(missing_ok=True)
            else:
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(source.read_bytes())
                target.chmod(source.stat().st_mode)
        data = os.environ.get("HAB_TEST_DATA") or str(checkout.parent / "shared/data")
        # These paths precede the finders of the editable installation.
        path = ":".join(str(self.folder / package) for package in PACKAGES)
        self._env = {**os.environ, "PYTHONPATH": path, "HAB_TEST_DATA": data}
        markers = (self.folder / "pyproject.toml").read_text()
        self._tiers = {
            tier: " and ".join(f"not {name}" for name in names if f'"{name}: ' in markers)
            for tier, names in TIERS.items()
        }
        self._check_imports()

    def _check_imports(self) -> None:
        """Prints where modules are imported from; raises if that is not the copy."""
        code = f"import hab_tasks, hab_eval, hab_{', hab_'.join(BASELINES)}, sys\n"
        code += "print(*(m.__file__ for n, m in sys.modules.items() if n.startswith('hab_') "
        code += "and '.' not in n), sep='\\n')"
        command = [self._python, "-c", code]
        files = subprocess.check_output(command, cwd=self.folder, env=self._env, text=True)
        print(files.splitlines()[0], flush=True)
        outside = [f for f in files.split() if not f.startswith(str(self.folder))]
        assert not outside, f"imported from outside the copy: {outside}"

    def failing(self, tests: list[str], tier: str, *options: str) -> str | None:
        """Returns the first test that fails, or None."""
        command = [self._python, "-m", "pytest", "-q", "-x", "-p", "no:randomly", "--tb=no"]
        command += ["-p", "no:cacheprovider", "-m", self._tiers[tier], *options, *tests]
        done = subprocess.run(command, cwd=self.folder, env=self._env, capture_output=True)
        output = done.stdout.decode(errors="replace")
        if done.returncode not in (0, 1, 2, 5):
            raise RuntimeError(output + done.stderr.decode(errors="replace"))
        found = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", output, re.MULTILINE)
        return found and found[1]

    def found_by(self, defect: Defect, tier: str, *, only_first: bool) -> str:
        """Returns the test that fails with a defect and passes without it, or `NOT_FOUND`."""
        file = self.folder / defect.file
        text = file.read_text()
        first = [f"tests/{name}" for name in defect.first.split()]
        first = [name for name in first if (self.folder / name).exists()]
        file.write_text(text.replace(defect.old, defect.new))
        try:
            found = first and self.failing(first, tier, "-n", "0")
            if not found and not only_first:
                ignored = [f"--ignore={name}" for name in first]
                found = self.failing(["tests"], tier, "-n", str(self.workers), *ignored)
        finally:
            file.write_text(text)
        if not found:
            return NOT_FOUND
        if self.failing([found], tier, "-n", "0"):
            return f"{NOT_FOUND}: {found} also fails without it"
        return found


def main() -> int:
    """Plants the defects one after another and runs the tests; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", default="", help="names, separated by commas; all if empty")
    parser.add_argument("--tier", default="", choices=["", *TIERS], help="overrides the rows'")
    parser.add_argument("--checkout", type=Path, default=ROOT, help="repository with a .venv")
    parser.add_argument("--workers", type=int, default=2, help="processes for the whole tier")
    parser.add_argument("--only-first", action="store_true", help="only the tests in `first`")
    options = parser.parse_args()
    wrong = misplaced(options.checkout)
    if wrong:
        print(f"old text does not occur exactly once: {', '.join(wrong)}")
        return 1
    names = options.rows.split(",") if options.rows else [d.name for d in DEFECTS]
    chosen = {d.name: d for d in DEFECTS}
    missing = 0
    with tempfile.TemporaryDirectory(prefix="hab-defects-") as folder:
        copy = Copy(options.checkout.resolve(), Path(folder), options.workers)
        for name in names:
            began, defect = time.monotonic(), chosen[name]
            tier = options.tier or defect.tier
            found = copy.found_by(defect, tier, only_first=options.only_first)
            missing += found.startswith(NOT_FOUND)
            print(f"{name:18} {time.monotonic() - began:5.0f} s  {found}", flush=True)
    print(f"{len(names) - missing} of {len(names)} found")
    return int(missing > 0)


if __name__ == "__main__":
    sys.exit(main())
