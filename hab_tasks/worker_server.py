"""Ends the server that forks worker processes at once when its parent ends.

The server removes its socket, which a parent that was killed leaves behind, and its workers are
killed or see that their parent has ended.
"""

import atexit
import contextlib
import os
from multiprocessing import forkserver
from pathlib import Path
from typing import Any


def _end() -> None:
    server: Any = forkserver._forkserver  # pyright: ignore[reportAttributeAccessIssue]
    if server._forkserver_address and server._forkserver_pid is None:  # not in the parent
        socket = Path(server._forkserver_address)
        with contextlib.suppress(OSError):  # the parent has removed it, or has others there
            socket.unlink()
            socket.parent.rmdir()
        os._exit(0)  # without freeing what it has imported, which takes a second


atexit.register(_end)
