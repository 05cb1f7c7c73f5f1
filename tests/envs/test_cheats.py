"""No scripted cheat wins more than random actions do."""

import logging
import os

import pytest
from cheating import CHEATS, LEFT, played, too_fast

LOG = logging.getLogger(__name__)
EPISODES = int(os.environ.get("HAB_CHEAT_EPISODES", "10"))
"""At most 50, of the shipped evaluation sets."""


@pytest.mark.long
@pytest.mark.parametrize("name", CHEATS)
def test_a_cheat_wins_no_more_than_random_actions(name):
    cheat = CHEATS[name]
    won, seen = played(cheat, EPISODES)
    # What comes too early, or goes off, must not happen at all.
    never = cheat.won is too_fast or name.removesuffix("_there") in LEFT
    at_random = [] if never else played(cheat, EPISODES, cheat.like)[0]
    placed = sum("placed" in world for world in seen)
    LOG.info("%s: %d (%d placed); at random %d", name, len(won), placed, len(at_random))
    assert len(won) <= len(at_random), won
    assert name not in ("thrown_there", "below_there") or placed > EPISODES / 5
