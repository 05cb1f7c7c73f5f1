"""The work of `hab-eval verify` and `film`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from hab_eval.commands.record_options import FilmCommand, RepeatCommand, VerifyCommand
from hab_eval.records.config import parse_options
from hab_eval.records.plain_text import show
from hab_eval.records.results import FinishedEpisode, RunRecord, highlights, read_record, video_name
from hab_eval.records.submissions import find_submission
from hab_eval.run.evaluate import MOST_WORKERS
from hab_eval.run.progress import make_reporter
from hab_eval.run.replay import (
    DIFFERENT,
    Difference,
    Replay,
    closing_lines,
    comparison_table,
    draw,
    level_of,
    replay,
)
from hab_tasks.errors import OptionError
from hab_tasks.io.files import check_file, scratch_folder
from hab_tasks.option_values import whole

EXIT_DIFFERENT = 1


def verify(options: VerifyCommand) -> int:
    """Repeats the episodes and prints the comparison."""
    name, record = read_submission(options)
    drawn = draw(len(record.episodes), options.episodes, options.sample_seed)
    indices = chosen(options.episode, record) or drawn
    repeated, differences = repeat(
        options, request_of(options, record, indices, workers=options.workers)
    )
    recorded = [record.episodes[index] for index in indices]
    show(comparison_table(name, recorded, [one.episode for one in repeated]))
    for line in closing_lines(record, len(indices), differences):
        print(line)
    return 0 if level_of(differences) != DIFFERENT else EXIT_DIFFERENT


def film(options: FilmCommand) -> int:
    """Repeats and records the episodes."""
    name, record = read_submission(options)
    indices = chosen(options.episode, record) or highlights(record)
    stems = {index: video_name(index, record.episodes[index].id) for index in indices}
    folder = options.out / name
    for stem in stems.values():
        check_file(folder / f"{stem}.mp4", force=options.force)
    with scratch_folder(options.out) as scratch:
        request = request_of(options, record, indices, workers=options.workers, videos=scratch)
        _, differences = repeat(options, request)
        different = {one.episode for one in differences if not one.small}
        for index, stem in stems.items():
            if record.episodes[index].id not in different:
                _move_video(scratch / f"{stem}.mp4", folder)
                print(f"wrote {folder / f'{stem}.mp4'}")
    for line in closing_lines(record, len(indices), differences):
        print(line)
    return 0 if level_of(differences) != DIFFERENT else EXIT_DIFFERENT


def read_submission(options: RepeatCommand) -> tuple[str, RunRecord]:
    """Returns the name and the content of the submission."""
    path = find_submission(options.submission, options.submissions)
    name = path.resolve().parent.name if path.name == "run.json" else path.stem
    return name, read_record(path)


def chosen(indices: Sequence[int], record: RunRecord) -> tuple[int, ...]:
    """Returns the indices given by --episode."""
    for index in indices:
        if not 0 <= index < len(record.episodes):
            valid = f"from 0 to {len(record.episodes) - 1}"
            raise OptionError.of_value("--episode", index, valid)
    return tuple(sorted(set(indices)))


def request_of(
    options: RepeatCommand,
    record: RunRecord,
    indices: Sequence[int],
    *,
    workers: int = 1,
    videos: Path | None = None,
    motions: Path | None = None,
) -> Replay:
    """Returns which episodes to repeat, and how; records videos or motions into a folder."""
    whole("workers", workers, 1, MOST_WORKERS)
    return Replay(
        record=record,
        indices=indices,
        scene_dataset=options.scene_dataset,
        objects=options.objects,
        options=parse_options(options.option),
        device=options.device,
        workers=workers,
        videos=videos,
        motions=motions,
    )


def repeat(
    options: RepeatCommand, request: Replay
) -> tuple[list[FinishedEpisode], list[Difference]]:
    """Repeats the episodes, with progress."""
    reporter = make_reporter(
        terminal=sys.stderr.isatty(),
        verbose=options.verbose,
        write_line=lambda line: print(line, flush=True),
    )
    return replay(request, reporter)


def _move_video(video: Path, folder: Path) -> None:
    """Moves a video and its first frame; both are on the same disk."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in (video.with_suffix(".png"), video):
        path.replace(folder / path.name)
