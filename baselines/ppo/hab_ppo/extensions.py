"""What other packages add to this one: agents, commands and files of weights, as entry points."""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points


@cache
def extensions(what: str) -> dict[str, EntryPoint]:
    """Returns the entry points of the group ``hab_ppo.what`` by name; loading one imports it.

    Args:
        what: ``agents``, factories; ``commands``, classes of `Command`; ``shipping``, modules with
            ``is_run(folder)``, ``ship(folder)`` and ``cards(records)``.
    """
    return {found.name: found for found in entry_points(group=f"hab_ppo.{what}")}
