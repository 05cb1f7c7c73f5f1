"""Processes that are killed at a given line of code, and their remains."""

import signal
import subprocess
import sys
import textwrap
from pathlib import Path

FILE = """
    from pathlib import Path
    from hab_tasks.io.files import written_aside
    with written_aside(Path({path!r})) as scratch:
        scratch.write_text("half")
        os.kill(os.getpid(), signal.SIGKILL)
"""
FOLDER = """
    from pathlib import Path
    from hab_tasks.io.files import folder_written_aside
    with folder_written_aside(Path({path!r})) as scratch:
        (scratch / "half").write_text("half")
        os.kill(os.getpid(), signal.SIGKILL)
"""


def killed_while_writing(code: str, path: Path) -> None:
    """Runs `FILE` or `FOLDER` on `path` in a process, which is killed in the middle of it."""
    text = "import os, signal\n" + textwrap.dedent(code).format(path=str(path))
    done = subprocess.run([sys.executable, "-c", text], check=False)
    assert done.returncode == -signal.SIGKILL


def session_of(pid: int) -> list[int]:
    """Returns the ids of a session's processes that still run."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            _, _, rest = stat.read_text().rpartition(") ")
        except (FileNotFoundError, ProcessLookupError):
            continue
        state, _, _, session, *_ = rest.split()
        if int(session) == pid and state != "Z":
            found.append(int(stat.parent.name))
    return found
