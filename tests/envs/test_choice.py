"""Invalid episode numbers in `reset` options."""

import pytest

from hab_tasks.errors import EpisodeError


def test_an_episode_outside_the_set_is_refused(make):
    """The file has eight, of which five are played: 0 to 4."""
    env = make(num_episodes=5)
    for wish in (5, -1, 10**7):
        message = rf"Episode {wish}: valid indices are 0 to 4"
        with pytest.raises(EpisodeError, match=message) as caught:
            env.reset(options={"episode": wish})
        # The file's sixth one can be had.
        assert ("num_episodes=6" in str(caught.value)) == (wish == 5)
    env.reset(options={"episode": 4})


def test_what_is_no_episode_is_refused(make):
    with pytest.raises(EpisodeError, match="'7' is neither an index nor an Episode"):
        make().reset(options={"episode": "7"})
