"""Largest values of the commands' options."""

from __future__ import annotations

MOST_RANKS = 256
MOST_ROWS = 4096
MOST_EPISODES = 1_000_000
MOST_STEPS = 10**12
