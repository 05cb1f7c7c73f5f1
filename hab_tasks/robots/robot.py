"""The robot of the benchmark."""

from __future__ import annotations

from hab_tasks.robots.fetch_spec import FETCH

ROBOT = FETCH
