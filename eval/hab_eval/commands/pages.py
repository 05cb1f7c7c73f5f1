"""The work of `hab-eval table`, `submit`, `site`, `failures` and `compare`."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Mapping
from pathlib import Path

from hab_eval.bench.report import read_report, report_table
from hab_eval.commands.record_options import (
    CompareCommand,
    FailuresCommand,
    SiteCommand,
    SubmitCommand,
    TableCommand,
)
from hab_eval.errors import ResultError
from hab_eval.records.failures import check_picture, draw_failures, failure_table
from hab_eval.records.leaderboard import (
    default_submissions,
    leaderboard_texts,
    read_submissions,
)
from hab_eval.records.paired import difference_table, pair_of, summary
from hab_eval.records.plain_text import show
from hab_eval.records.results import RunRecord, read_runs, write_record
from hab_eval.records.status import TABLES
from hab_eval.records.submissions import (
    check_name,
    check_submission,
    cleanliness,
    submission_name,
)
from hab_eval.site.build import SiteOptions, build_site
from hab_tasks.errors import OptionError
from hab_tasks.io.files import check_file, written_aside

EXIT_OUT_OF_DATE = 1


def write_tables(options: TableCommand) -> int:
    """Writes or checks the leaderboard."""
    submissions = options.submissions or default_submissions()
    benchmarks = options.benchmarks or submissions.parent.parent / "benchmarks"
    target = options.out or submissions.parent / "LEADERBOARD.md"
    found = read_submissions(submissions)
    if not target.name:
        raise OptionError(f"--out {target} is a folder; give a file name.")
    if target.suffix == ".html":
        raise OptionError(
            f"--out {target} is the name of the web page; give a name that ends in .md."
        )
    texts = leaderboard_texts(found, target)
    for path in options.pages:
        link = os.path.relpath(target, path.parent)
        texts[path] = filled(_text_of(path), found, benchmarks, link)
    for path in () if options.check else texts:
        check_file(path, force=True)  # both or none
    for path, text in texts.items():
        if not options.check:
            with written_aside(path) as scratch:
                scratch.write_text(text, encoding="utf-8")
            print(f"wrote {path}")
        elif not os.path.isfile(path) or path.read_bytes() != text.encode("utf-8"):
            print(f"hab-eval: {path} is out of date; run hab-eval table.", file=sys.stderr)
            return EXIT_OUT_OF_DATE
    return 0


def _text_of(page: Path) -> str:
    try:
        return page.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise OptionError(f"--pages {page}: cannot be read ({error}).") from error


def submit(options: SubmitCommand) -> int:
    """Checks and copies the run, then writes the leaderboard."""
    (record,) = read_runs([options.run_path])
    check_submission(record, str(options.run_path))
    folder = options.submissions or default_submissions()
    stem = check_name(options.name) if options.name is not None else submission_name(record)
    target = folder / f"{stem}.json"
    found = {**read_submissions(folder), target.name: record}
    texts = leaderboard_texts(found, folder.parent / "LEADERBOARD.md")
    _check_new(target, force=options.force)
    for path in texts:
        check_file(path, force=True)
    write_record(target, record)
    print(f"wrote {target}")
    print(cleanliness(record))
    for path, text in texts.items():
        with written_aside(path) as scratch:
            scratch.write_text(text, encoding="utf-8")
        print(f"wrote {path}")
    print("Tables within pages: hab-eval table --pages README.md --pages docs/status.md")
    return 0


def _check_new(target: Path, *, force: bool) -> None:
    """Checks that a submission does not exist, or may be replaced."""
    if target.exists() and not force:
        raise OptionError(
            f"{target} exists; give --force to replace it, or --name for another name."
        )
    check_file(target, force=force)


def build(options: SiteCommand) -> int:
    """Writes the site."""
    site = SiteOptions(
        out=options.out,
        runs=options.runs,
        submissions=options.submissions,
        videos=options.videos,
        checkout=options.checkout,
        force=options.force,
    )
    pages = build_site(site)
    print(f"wrote {pages} pages; open {options.out / 'index.html'}")
    return 0


def show_failures(options: FailuresCommand) -> int:
    """Prints and plots the failure categories."""
    check_picture(options.out, force=options.force)
    records = read_runs(options.runs)
    draw_failures(records, options.out)
    show(failure_table(records))
    print(f"wrote {options.out}")
    return 0


def show_comparison(options: CompareCommand) -> int:
    """Prints what two runs differ in."""
    runs = (options.first, options.second)
    records = read_runs(runs)
    pair = pair_of(records)
    print(summary(records, pair))
    if pair.only_first or pair.only_second:
        show(difference_table(records, [run if run.is_dir() else run.parent for run in runs]))
        print("Films of the others: hab-eval film RUN --episode INDEX --out DIR")
    return 0


BEGIN = re.compile(r"<!-- (?P<kind>status|bench): (?P<what>[^>]+?) -->\n")


def filled(
    page: str, submissions: Mapping[str, RunRecord], benchmarks: Path, leaderboard: str
) -> str:
    """Regenerates the tables of a page.

    Args:
        page: Text of the page.
        submissions: All submissions.
        benchmarks: Folder of the benchmark reports.
        leaderboard: Link from the page to LEADERBOARD.md.

    Raises:
        ResultError: A table has no end mark, its name is unknown, or its report cannot be read.
    """
    parts, at = [], 0
    for begin in BEGIN.finditer(page):
        kind, what = begin["kind"], begin["what"]
        mark = f"<!-- end of {kind} -->"
        end = page.find(mark, begin.end())
        if end < 0:
            raise ResultError(f"The {kind} table {what} has no end mark {mark!r}.")
        if kind == "bench":
            name, _, unit = what.partition(" ")
            text = report_table(read_report(benchmarks / f"{name}.json"), unit)
        elif what in TABLES:
            text = TABLES[what](submissions, leaderboard)
        else:
            raise ResultError(f"No status table {what!r}; tables: {', '.join(sorted(TABLES))}.")
        parts += [page[at : begin.end()], text]
        at = end
    return "".join([*parts, page[at:]])
