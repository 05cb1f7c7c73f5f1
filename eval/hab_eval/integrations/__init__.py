"""Policies in other processes, and other harnesses."""

from importlib import util

from hab_tasks.errors import HabError

for _name in ("msgpack", "websockets"):
    if util.find_spec(_name) is None:
        raise HabError(f"{_name} is not installed; run: pip install 'hab-eval[remote]'")
