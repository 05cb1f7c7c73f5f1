"""Instructions: fixed and varied wordings, objects told apart, stages of a task."""

import math
from itertools import chain

import gymnasium as gym
import pytest

from hab_tasks import ENVS, EpisodeRequest, load_episodes
from hab_tasks.instructions import OBJECTS, PLACES, TEMPLATES, TWIN_M, Words, object_words
from hab_tasks.object_names import ALL_OBJECTS
from hab_tasks.receptacles import PHRASES


def test_no_two_things_share_a_name_and_held_out_words_are_others():
    fixed = [object_words(f"{name}_:0000") for name in ALL_OBJECTS]
    assert OBJECTS.keys() <= set(fixed)
    assert {phrase.partition(" the ")[2] for phrase in PHRASES.values()} == PLACES.keys()
    for table in (OBJECTS, PLACES):
        names = [name for choices in table.values() for name in chain(*choices)]
        assert len(names) == len(set(names))
    for key, (seen, held_out) in chain(OBJECTS.items(), PLACES.items(), TEMPLATES.items()):
        assert (seen[0], bool(held_out), set(seen) & set(held_out)) == (key, True, set())


@pytest.mark.parametrize("env_id", ["HabPick-v1", "HabTidyHouse-v1"])
def test_varied_instructions_differ_and_name_one_object_each(env_id):
    episodes = load_episodes(EpisodeRequest(env_id=env_id, split="test"), 20, None, 1).episodes
    env = ENVS[env_id].env
    told = {held_out: set() for held_out in (False, True)}
    for episode in episodes:
        for held_out in told:
            words = Words(seed=episode.seed, held_out=held_out)
            told[held_out].add(env.instruct(episode, words))
            for target in episode.targets:  # others of this name are elsewhere
                named = words.object(target.object, episode)
                twins = [n for n in episode.objects if words.object(n, episode) == named]
                here = [episode.objects[name][:2] for name in twins]
                assert words.source(target.start)
                assert len(twins) == 1 or min(map(math.dist, here, here[1:])) > TWIN_M
    assert not told[False] & told[True]
    assert len(told[True]) > 15


def test_twins_side_by_side_are_told_apart():
    episodes = load_episodes(EpisodeRequest(env_id="HabPick-v1"), 50, None, 1).episodes
    kinds = [(e, [n for n in e.objects if n[:3] == e.target[:3]]) for e in episodes]
    twins = [(episode, names) for episode, names in kinds if len(names) == 2]
    assert twins
    for episode, names in twins:
        words = Words(seed=episode.seed)
        told = {words.object(name, episode).partition(" ")[0] for name in names}
        assert told == {"left", "right"}


def test_the_stage_of_a_task_is_told():
    env = gym.make("HabSetTable-v1", obs_mode="state_dict", targets="language").unwrapped
    obs, info = env.reset(seed=0)
    assert obs.keys() == {"agent"}
    ends = {0: "Open the drawer.", 1: "from the drawer.", 6: "into the bowl.", 8: "the fridge."}
    for reached, words in ends.items():
        env.rules.progress.stages[:] = reached
        assert env.stage_instruction[0].endswith(words)
    assert info["instruction"] == env.instruction
    env.close()
