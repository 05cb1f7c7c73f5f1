"""Change of layout in a running simulation: equal to a new simulation, no remains of the old."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from builders import go_above_and_grasp, same
from playing import actions, move_joint, record

from hab_tasks.episodes import EpisodeRequest, open_source
from hab_tasks.errors import EpisodeError
from hab_tasks.scenes.lights import MAX_LIGHTS

LAYOUTS = ("v3_sc0_staging_00", "v3_sc3_staging_00", "apt_0")
"""Two that are staged, with other furniture and lamps, and one full of loose objects."""


def episode_of(env_id, scene_id):
    return open_source(EpisodeRequest(env_id=env_id, scene=scene_id, seed=3)).get(0)


class Episodes(dict):
    """Env id -> an episode in each layout, made when it is asked for."""

    def __missing__(self, env_id):
        self[env_id] = [episode_of(env_id, scene_id) for scene_id in LAYOUTS]
        return self[env_id]


@pytest.fixture(scope="module")
def episodes(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HAB_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        yield Episodes()


@pytest.fixture
def held(episodes):
    """A start state of Place: the object is in the hand."""
    return episodes["HabPlace-v1"][0]


def start(env, *episodes, play=False, **options):
    """Starts episodes one after another, grasping where `play`; returns the last observation."""
    for episode in episodes:
        obs, _ = env.reset(options={"episode": episode, **options})
        if play and episode is not episodes[-1]:
            play_in(env, episode)
    return obs


def play_in(env, episode):
    """Disturbs a layout: something is taken up, a door opened, and all that can move moves."""
    base = env.unwrapped
    if base.control_mode == "ee" and episode.held is None:
        go_above_and_grasp(env, episode.target)
    if base.requirements.articulations:
        state = base.get_state_dict()
        move_joint(state, env, 0, 0.2)
        base.set_state_dict(state)
    for action in actions(env, 8, gripper=1.0):
        env.step(action)


def view(env):
    """The complete current state."""
    (state,) = env.unwrapped.privileged()
    return {
        "state": env.unwrapped.get_state_dict(),
        "measures": dict(vars(env.unwrapped.measures)),
        "poses": dict(state.world_from_body),
        "coms": state.object_com_m,
        "shapes": {
            b.name: {str(i): s.vertices_m for i, s in enumerate(b.shapes)} for b in state.bodies
        },
        "joints": {"arm": state.arm_qpos, **state.locked_qpos},
    }


def keys(value):
    return {k: keys(v) for k, v in value.items()} if isinstance(value, dict) else None


@pytest.mark.parametrize("last", range(3), ids=LAYOUTS)
def test_a_layout_after_others_equals_a_fresh_environment(make, episodes, last):
    """Objects were taken and doors opened in the others."""
    env_id = "HabSetTable-v1"
    options = {"obs_mode": "state_dict"}
    order = [*episodes[env_id][last + 1 :], *episodes[env_id][: last + 1]]
    fresh, worn = make(env_id, **options), make(env_id, **options)
    expected = start(fresh, order[-1])
    assert same(start(worn, order[-1], *order, play=True), expected)
    a, b = view(fresh), view(worn)
    assert list(b["state"]["actors"]) == list(a["state"]["actors"])
    assert keys(b["state"]) == keys(a["state"])
    assert same(b, a)


@pytest.mark.slow
@pytest.mark.parametrize("env_id", ["HabOpenFridge-v1", "HabSetTable-v1"])
def test_it_goes_on_alike_and_a_new_simulation_exactly(make, episodes, env_id):
    """To the last bit in a new simulation; an old one keeps traces of what it showed before."""
    options = {"obs_mode": "state_dict"}
    first, second, _ = episodes[env_id]
    runs = []
    for before, reset in (
        ((), {}),
        ((first, second), {}),
        ((first, second), {"reconfigure": True}),
    ):
        env = make(env_id, **options)
        if before:
            start(env, *before, play=True)
        start(env, first, **reset)
        runs.append(record(env, actions(env, 20, seed=1, gripper=-1.0)))
    for step, (fresh, shown, rebuilt) in enumerate(zip(*runs, strict=True)):
        assert same(fresh, rebuilt), f"step {step}"
        assert same(fresh["obs"], shown["obs"], atol=1e-4), f"step {step}"


@pytest.mark.slow
@pytest.mark.parametrize("env_id", ["HabPick-v1", "HabSetTable-v1"])
def test_a_state_can_be_restored_after_other_layouts(make, episodes, env_id):
    env = make(env_id, obs_mode="state_dict")
    start(env, *episodes[env_id], episodes[env_id][0], play=True)
    record(env, actions(env, 5, gripper=-1.0))
    state = env.unwrapped.get_state_dict()
    sequence = actions(env, 15, seed=1, gripper=-1.0)
    original = record(env, sequence)
    env.unwrapped.set_state_dict(state)
    assert same(env.unwrapped.get_state_dict(), state, atol=1e-5)
    other = make(env_id, obs_mode="state_dict")
    start(other, episodes[env_id][0])
    other.unwrapped.set_state_dict(state)
    for run in (record(env, sequence), record(other, sequence)):
        for step, (a, b) in enumerate(zip(original, run, strict=True)):
            assert same(a["obs"], b["obs"], atol=1e-4), f"step {step}"


@pytest.mark.parametrize("env_id", ["HabPick-v1", "HabSetTable-v1"])
def test_the_scene_key_tells_layouts_apart(make, episodes, env_id):
    env = make(env_id)
    first, second, _ = episodes[env_id]

    def key(episode):
        start(env, episode)
        return env.unwrapped.privileged()[0].scene_key

    once = key(first)
    assert key(first) == once
    other = key(second)
    assert other != once
    assert env.unwrapped.privileged()[0].scene_key == other


@pytest.mark.parametrize("env_id", ["HabPick-v1", "HabSetTable-v1"])
def test_segmentation_names_what_is_shown(make, episodes, env_id):
    env = make(env_id)
    for episode in (*episodes[env_id], episodes[env_id][0]):
        start(env, episode)
        base = env.unwrapped
        scene_bodies = base._simulation.scene_bodies
        named = base.segmentation_id_map
        expected = {
            **{
                a._objs[0].per_scene_id: n
                for n, a in {**scene_bodies.static, **scene_bodies.movable}.items()
            },
            scene_bodies.stage._objs[0].per_scene_id: scene_bodies.stage.name,
        }
        for furniture in scene_bodies.articulations.values():
            expected |= {k._objs[0].entity.per_scene_id: k.name for k in furniture.links}
        expected |= {k._objs[0].entity.per_scene_id: k.name for k in base.agent.robot.links}
        assert {i: body.name for i, body in named.items()} == expected


def test_an_object_that_was_not_loaded_is_named(make, episodes):
    env, (episode, *_) = make("HabPick-v1"), episodes["HabPick-v1"]
    pose = episode.objects[episode.target]
    with pytest.raises(EpisodeError, match="077_rubiks_cube"):
        start(env, replace(episode, objects={**episode.objects, "077_rubiks_cube_:0000": pose}))


# An object that starts in the hand -------------------------------------------------------------


@pytest.mark.parametrize(
    ("after", "move", "within_m"), [(False, 0.0, 0.001), (True, 1.0, 0.005)], ids=["fresh", "worn"]
)
def test_a_held_object_starts_in_the_grasp_and_stays_there(
    make, episodes, held, after, move, within_m
):
    env = make("HabPick-v1", control_mode="ee")
    start(env, *(episodes["HabPick-v1"] if after else ()), held)
    base = env.unwrapped
    (state,) = base.privileged()
    assert state.held == held.held
    assert base.measures.holding_target
    link = state.world_from_body["hab_fetch/gripper_link"]
    # The end-effector is 8 cm ahead of the gripper's link; the centre of mass is there.
    assert np.allclose(state.object_com_m[held.held], link[:3, 3] + 0.08 * link[:3, 0], atol=1e-3)
    in_hand = np.linalg.inv(link) @ state.world_from_body[held.held]
    for action in actions(env, 10):
        base.step(np.append(move * action[:3], 1.0).astype(np.float32))
        (state,) = base.privileged()
        now = np.linalg.inv(state.world_from_body["hab_fetch/gripper_link"])
        now = now @ state.world_from_body[held.held]
        assert np.linalg.norm(now[:3, 3] - in_hand[:3, 3]) < within_m
        assert state.held == held.held


def test_a_held_object_is_let_go_when_another_episode_starts(make, episodes, held):
    env = make("HabPick-v1", obs_mode="state_dict")
    expected = start(env, episodes["HabPick-v1"][0])
    start(env, held)
    assert same(start(env, episodes["HabPick-v1"][0]), expected)
    assert env.unwrapped.privileged()[0].held is None


# Pictures --------------------------------------------------------------------------------------


def lamps(env):
    scene = env.unwrapped.scene.sub_scenes[0]
    kinds = [type(c).__name__ for e in scene.entities for c in e.components]
    return kinds.count("RenderPointLightComponent")


@pytest.mark.render
@pytest.mark.slow
def test_a_layout_looks_the_same_when_it_comes_again(make, episodes):
    env_id = "HabSetTable-v1"
    options = {"obs_mode": "rgb+segmentation"}
    fresh, worn = make(env_id, **options), make(env_id, **options)
    first, second, _ = episodes[env_id]
    pictures = []
    for env, order in ((fresh, [first]), (worn, [first, second, first])):
        for episode in order:
            obs = start(env, episode)
            spec = env.unwrapped._simulation.scene_bodies.spec
            assert lamps(env) == min(len(spec.lights), MAX_LIGHTS) > 0
        pictures.append({name: images for name, images in obs["sensor_data"].items()})
    for name, images in pictures[0].items():
        ids = images["segmentation"]
        assert torch.equal(pictures[1][name]["rgb"], images["rgb"]), name
        assert len(torch.unique(ids)) > 3
        shown = {
            fresh.unwrapped.segmentation_id_map[i].name for i in torch.unique(ids).tolist() if i
        }
        ids = pictures[1][name]["segmentation"]
        again = {
            worn.unwrapped.segmentation_id_map[i].name for i in torch.unique(ids).tolist() if i
        }
        assert shown == again
