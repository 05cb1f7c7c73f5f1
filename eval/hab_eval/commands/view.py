"""The work of `hab-eval view`."""

from __future__ import annotations

import tempfile
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

from hab_eval.commands.record_options import ViewCommand
from hab_eval.commands.replay import EXIT_DIFFERENT, chosen, read_submission, repeat, request_of
from hab_eval.run.motion import read_motion
from hab_eval.run.replay import DIFFERENT, closing_lines, level_of
from hab_tasks.errors import OptionError
from hab_tasks.io.files import check_file, written_aside

SUFFIXES = (".html", ".viser")


def view(options: ViewCommand) -> int:
    """Repeats the episode, and writes its recording or serves it."""
    from hab_eval.view import record  # needs viser: said before the episode

    _, record_of_run = read_submission(options)
    (index,) = chosen((options.episode,), record_of_run)
    suffix = ".html" if options.out is None else options.out.suffix
    if suffix not in SUFFIXES:
        raise OptionError.of_value("--out", str(options.out), "a file name in .html or .viser")
    if options.out is not None:
        check_file(options.out, force=options.force)
    with tempfile.TemporaryDirectory() as folder:
        request = request_of(options, record_of_run, (index,), motions=Path(folder))
        repeated, differences = repeat(options, request)
        content = record(read_motion(Path(folder)), repeated[0].trace, suffix)
    for line in closing_lines(record_of_run, 1, differences):
        print(line)
    if options.out is not None:
        with written_aside(options.out) as scratch:
            scratch.write_bytes(content)
        print(f"wrote {options.out} ({len(content) / 1e6:.1f} MB)")
    else:
        _serve(content)
    return 0 if level_of(differences) != DIFFERENT else EXIT_DIFFERENT


def _serve(page: bytes) -> None:
    """Serves a page on the loopback interface until Ctrl-C."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(page)))
            self.end_headers()
            self.wfile.write(page)

        def log_message(self, format: str, *args: object) -> None: ...

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        print(f"open http://127.0.0.1:{server.server_port}/ (Ctrl-C ends)", flush=True)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            return
