"""Prepares a folder for the Hugging Face hub: files, card, licence and checksums."""

from __future__ import annotations

import hashlib
import shutil
from importlib import metadata
from pathlib import Path
from typing import Any

from hab_spa.cli import PublishCommand
from hab_spa.recording.plan import LEROBOT, NAME
from hab_tasks.errors import OptionError
from hab_tasks.io.console import tell
from hab_tasks.io.files import check_folder, folder_written_aside
from hab_tasks.option_values import whole

SUMS = "SHA256SUMS"
OURS = "apache-2.0"
"""Licence of weights, environments, and recordings in the shipped apartment."""

ENVIRONMENT = "environment"

SHOWN = ("action", "observation.", "subtask")
"""Features that a card lists."""

ENV_FILE = '''"""Loaded by lerobot.envs.make_env("USER/REPO", trust_remote_code=True)."""

from lerobot_env_hab import make_env

__all__ = ["make_env"]
'''

HEAD = """---
license: {license}
tags: [{tags}]
{more}---

"""

DATASET_CARD = """# Demonstrations of {env}

{episodes:,} demonstrations ({frames:,} frames, {tasks:,} instructions) of `{env}`, an environment
of the Home Assistant Benchmark in [hab-tasks]({address}).

| | |
|---|---|
| agent | {agent} |
| scenes | {scenes}, split `{split}`, seed {seed} |
| actions | `{control_mode}`, {fps} per second |
| features | {features} |

`observation.state` is proprioception. `observation.environment_state`, if present, has the
positions of targets: leave it out where only the instruction may tell the goal. `subtask` is the
instruction of the current stage. Depth images are in millimetres. The contract of hab-tasks
(docs/contract.md) describes every entry.

```python
from lerobot.datasets.lerobot_dataset import LeRobotDataset

dataset = LeRobotDataset("USER/REPO")
```

`maniskill/` has the same episodes for ManiSkill; `mani_skill.trajectory.replay_trajectory` replays
them.
"""

ENVIRONMENT_CARD = """# Home Assistant Benchmark

Seven skills and three long tasks of [hab-tasks]({address}) as environments of LeRobot.

```bash
pip install -r requirements.txt
```

```python
from lerobot.envs import make_env

envs = make_env("USER/REPO", trust_remote_code=True)
```
"""


def run(options: PublishCommand) -> int:
    """Writes the folder, and prints how to upload it."""
    check_folder(options.out, force=options.force, mark=SUMS)
    whole("--episodes", options.episodes, 1, 1_000_000)
    source, kind = Path(options.source), "model"
    with folder_written_aside(options.out) as folder:
        if options.source == ENVIRONMENT:
            _environment(folder)
        elif source.suffix == ".safetensors" and source.with_suffix(".md").is_file():
            _weights(source, folder)
        elif (source / LEROBOT / "meta" / "info.json").is_file():
            kind = "dataset"
            _dataset(source, folder, options)
        else:
            raise OptionError(
                f"{source} is neither a folder of hab-spa record --lerobot, nor a .safetensors "
                f"file with its card (.md) beside it, nor {ENVIRONMENT!r}."
            )
        _sums(folder)
    size_mb = sum(one.stat().st_size for one in options.out.rglob("*") if one.is_file()) / 1e6
    tell(f"wrote {options.out}, {size_mb:.1f} MB; nothing was uploaded. To upload it:")
    tell(f"hf upload USER/REPO {options.out} --repo-type {kind}")
    return 0


def _dataset(source: Path, folder: Path, options: PublishCommand) -> None:
    """Writes the first episodes of a recording, in both formats."""
    # It needs pyarrow, which is optional.
    from hab_spa.recording.sample import copy_dataset, copy_trajectory

    info = copy_dataset(source / LEROBOT, folder, options.episodes)
    told = copy_trajectory(source, folder / "maniskill", options.episodes)
    env: dict[str, Any] = told["env_info"]["env_kwargs"]
    ours = env["scene_dataset"] == "apartment" and env["objects"] is None
    if not ours and options.license is None:
        raise OptionError(
            f"{source / NAME}.h5 was recorded in {env['scene_dataset']}: give the licence of its "
            "images with --license, e.g. cc-by-nc-4.0 for ReplicaCAD."
        )
    card = DATASET_CARD.format(
        env=told["env_info"]["env_id"].rpartition(":")[2],
        episodes=info["total_episodes"],
        frames=info["total_frames"],
        tasks=len({entry["task"] for entry in told["episodes"]}),
        address=_address(),
        agent=told["source_desc"].partition(", recorded")[0],
        # The name only: its folder is of the machine that recorded.
        scenes=Path(env["scene_dataset"]).name,
        split=env["split"],
        seed=env["episode_seed"],
        control_mode=env["control_mode"],
        fps=info["fps"],
        features=", ".join(f"`{name}`" for name in info["features"] if name.startswith(SHOWN)),
    )
    more = "task_categories: [robotics]\nconfigs:\n- config_name: default\n"
    more += "  data_files: data/*/*.parquet\n"
    _card(folder, card, options.license or OURS, "LeRobot, hab-tasks, maniskill", more)


def _weights(file: Path, folder: Path) -> None:
    """Copies weights, with their card and its picture."""
    shutil.copyfile(file, folder / file.name)
    picture = file.with_suffix(".png")
    if picture.is_file():
        shutil.copyfile(picture, folder / picture.name)
    more = "library_name: hab-ppo\npipeline_tag: robotics\n"
    _card(folder, file.with_suffix(".md").read_text(encoding="utf-8"), OURS, "hab-tasks", more)


def _environment(folder: Path) -> None:
    (folder / "env.py").write_text(ENV_FILE, encoding="utf-8")
    version = metadata.version("hab-tasks")
    (folder / "requirements.txt").write_text(f"lerobot-env-hab=={version}\n", encoding="utf-8")
    card = ENVIRONMENT_CARD.format(address=_address())
    _card(folder, card, OURS, "LeRobot, hab-tasks, maniskill, environment", "")


def _card(folder: Path, text: str, license_id: str, tags: str, more: str) -> None:
    """Writes the card, and the licence's text where it is ours."""
    head = HEAD.format(license=license_id, tags=tags, more=more)
    (folder / "README.md").write_text(head + text, encoding="utf-8")
    if license_id == OURS:
        files = metadata.files("hab-spa") or []
        text = next(one for one in files if one.name == "LICENSE").read_text(encoding="utf-8")
        (folder / "LICENSE").write_text(text, encoding="utf-8")


def _sums(folder: Path) -> None:
    """Writes the checksums of all other files, for `sha256sum --check`."""
    files = sorted(one for one in folder.rglob("*") if one.is_file())
    lines = [f"{_sha256(one)}  {one.relative_to(folder).as_posix()}\n" for one in files]
    (folder / SUMS).write_text("".join(lines), encoding="utf-8")


def _sha256(file: Path) -> str:
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def _address() -> str:
    """Returns the address of the project."""
    found = metadata.metadata("hab-tasks").get_all("Project-URL") or []
    return found[0].partition(", ")[2]
