"""`hab-tasks list` and `episodes`: the table of environments, and a file of one's episodes."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from hab_tasks.commands.options import Episodes, List
from hab_tasks.envs import ENVS
from hab_tasks.episodes import EpisodeRequest, open_source
from hab_tasks.episodes.made_files import EpisodeJournal
from hab_tasks.episodes.source import UNLIMITED
from hab_tasks.errors import HabError
from hab_tasks.io.console import GenerationLines, progress_bar
from hab_tasks.io.executors import open_executor
from hab_tasks.io.files import check_file
from hab_tasks.option_values import LARGEST_SEED, MOST_WORKERS, whole
from hab_tasks.registration import imported_id


def list_environments(_options: List) -> int:
    """Prints the table."""
    for entry in ENVS.values():
        modes = ", ".join(entry.env.control_modes)
        print(f"{entry.id}: {entry.horizon_steps} steps; control {modes}")
        print(f"  {entry.env.summary()}")
        for item in entry.env.observation:
            shape = "x".join(map(str, item.shape))
            print(f"  {item.name:<20} {shape:>4}  {item.unit:<7} {item.meaning}")
    return 0


EPISODE_ENDINGS = (".json", ".json.gz")


def run(options: Episodes) -> int:
    """Generates and writes the file, then prints the rejected samples by reason."""
    _check(options)
    source = open_source(
        EpisodeRequest(
            env_id=options.env,
            scene_dataset=options.scene_dataset,
            objects=options.objects,
            split=options.split,
            scene=options.scene,
            seed=options.seed,
            novel=options.novel,
        )
    )
    journal = EpisodeJournal(options.journal, source.configuration())
    journal.open(resume=options.resume, force=options.force)
    source.restore(journal.entries, options.count)
    lines = GenerationLines(partial(print, flush=True))
    with (
        open_executor(options, options.workers) as executor,
        progress_bar("episode", lines.show) as show,
    ):
        source.prepare(options.count, executor, show, journal.append)
    source.save(options.count, options.out)
    journal.remove()
    print(f"wrote {options.count} episodes ({source.split}) to {options.out}")
    for reason, times in sorted(source.rejections.items()):
        print(f"  rejected {times}: {reason}")
    return 0


def _check(options: Episodes) -> None:
    imported_id(options.env)
    options.check_executor()
    whole("--count", options.count, 1, UNLIMITED)
    whole("--seed", options.seed, 0, LARGEST_SEED)
    whole("--workers", options.workers, 1, MOST_WORKERS)
    if options.resume and options.force:
        raise HabError("--resume keeps the generated episodes, --force drops them: give one.")
    check_ending(options.out)
    unfinished = options.resume and options.journal.exists()
    check_file(options.out, force=options.force or unfinished)


def check_ending(file: Path) -> None:
    """Raises HabError for an episode file without a valid suffix."""
    if not file.name.endswith(EPISODE_ENDINGS):
        raise HabError(f"--out {file}: an episode file must end in {' or '.join(EPISODE_ENDINGS)}.")
