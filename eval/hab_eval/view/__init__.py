"""Episodes in the browser, by viser."""

from importlib import util

from hab_tasks.errors import HabError

if util.find_spec("viser") is None:
    raise HabError("viser is not installed; run: pip install 'hab-eval[view]'")
