"""The work of `hab-eval bench`."""

from __future__ import annotations

from hab_eval.bench.report import make_report, row_table, write_report
from hab_eval.bench.suite import BenchOptions, find_suite, run_suite
from hab_eval.commands.options import BenchCommand
from hab_eval.records.plain_text import show
from hab_tasks.io.files import check_file


def run_bench(options: BenchCommand) -> int:
    """Runs the suite, then prints and writes the results."""
    bench = BenchOptions(
        suite=find_suite(options.suite),
        scene_dataset=options.scene_dataset,
        objects=options.objects,
        scenes=options.scene,
        envs=options.env,
        repeats=options.repeats,
        steps=options.steps,
    )
    check_file(options.json, force=options.force)  # before minutes are spent
    rows = run_suite(bench, lambda line: print(line, flush=True))
    write_report(options.json, make_report(options.suite, rows), force=options.force)
    show(row_table(rows))
    print(f"wrote {options.json}")
    return 0
