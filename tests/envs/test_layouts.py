"""Change of layout in a running simulation: equal to a new simulation, no remains of the old."""

import functools

import numpy as np
import pytest
import sapien
import torch
from builders import go_above_and_grasp, same
from playing import actions, move_joint, record

from hab_tasks.episodes import EpisodeRequest, open_source
from hab_tasks.world.scenes.build import MAX_LIGHTS

LAYOUTS = ("v3_sc0_staging_00", "v3_sc3_staging_00", "apt_0")
"""Two that are staged, with other furniture and lamps, and one full of loose objects."""


@pytest.fixture(scope="module")
def episodes(tmp_path_factory):
    """Env id -> an episode in each layout, made when it is asked for."""

    @functools.cache
    def of(env_id):
        requests = [EpisodeRequest(env_id=env_id, scene=scene_id, seed=3) for scene_id in LAYOUTS]
        return [open_source(request).get(0) for request in requests]

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HAB_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        yield of


def start(env, *episodes, **options):
    """Starts episodes one after another, disturbs all but the last one's; returns what it shows.

    Something is taken up, a door opened, and all that can move moves.
    """
    base, (*others, last) = env.unwrapped, episodes
    for episode in others:
        env.reset(options={"episode": episode, **options})
        if episode is last:
            continue
        if base.control_mode == "ee" and episode.held is None:
            go_above_and_grasp(env, episode.target)
        if base.requirements.articulations:
            state = base.get_state_dict()
            move_joint(state, env, 0, 0.2)
            base.set_state_dict(state)
        for action in actions(env, 8, gripper=1.0):
            env.step(action)
    return env.reset(options={"episode": last, **options})[0]


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


@pytest.mark.new_env
@pytest.mark.parametrize("last", range(3), ids=LAYOUTS)
def test_a_layout_after_others_equals_a_fresh_environment(make, episodes, last):
    """Objects were taken and doors opened in the others."""
    env_id = "HabSetTable-v1"
    options = {"obs_mode": "state_dict"}
    order = [*episodes(env_id)[last + 1 :], *episodes(env_id)[: last + 1]]
    fresh, worn = make(env_id, **options), make(env_id, **options)
    expected = start(fresh, order[-1])
    assert same(start(worn, order[-1], *order), expected)
    a, b = view(fresh), view(worn)
    assert list(b["state"]["actors"]) == list(a["state"]["actors"])
    assert same(b, a)


@pytest.mark.slow
@pytest.mark.parametrize("env_id", ["HabPick-v1", "HabSetTable-v1"])
def test_a_state_can_be_restored_after_other_layouts(make, episodes, env_id):
    env = make(env_id, obs_mode="state_dict")
    start(env, *episodes(env_id), episodes(env_id)[0])
    record(env, actions(env, 5, gripper=-1.0))
    state = env.unwrapped.get_state_dict()
    sequence = actions(env, 15, seed=1, gripper=-1.0)
    original = record(env, sequence)
    env.unwrapped.set_state_dict(state)
    assert same(env.unwrapped.get_state_dict(), state, atol=1e-5)
    other = make(env_id, obs_mode="state_dict")
    start(other, episodes(env_id)[0])
    other.unwrapped.set_state_dict(state)
    for run in (record(env, sequence), record(other, sequence)):
        for step, (a, b) in enumerate(zip(original, run, strict=True)):
            assert same(a["obs"], b["obs"], atol=1e-4), f"step {step}"


@pytest.mark.parametrize("env_id", ["HabPick-v1", "HabSetTable-v1"])
def test_scene_key_and_segmentation_name_what_is_shown(make, episodes, env_id):
    env = make(env_id)
    base, keys = env.unwrapped, []
    for episode in (*episodes(env_id), episodes(env_id)[0]):
        start(env, episode)
        keys.append(base.privileged()[0].scene_key)
        assert base.privileged()[0].scene_key == keys[-1]
        shown = base.simulation.scene_bodies
        actors = {**shown.static, **shown.movable, shown.stage.name: shown.stage}
        expected = {actor._objs[0].per_scene_id: name for name, actor in actors.items()}
        for piece in (base.agent.robot, *shown.articulations.values()):
            expected |= {link._objs[0].entity.per_scene_id: link.name for link in piece.links}
        assert {i: body.name for i, body in base.segmentation_id_map.items()} == expected
    # Another layout has another key.
    assert len({*keys[:-1]}) == len(LAYOUTS)


@pytest.mark.parametrize(
    ("after", "move", "within_m"), [(False, 0.0, 0.001), (True, 1.0, 0.005)], ids=["fresh", "worn"]
)
def test_a_held_object_starts_in_the_grasp_and_stays_there(make, episodes, after, move, within_m):
    """Until another episode starts."""
    env, held = make("HabPick-v1", obs_mode="state_dict"), episodes("HabPlace-v1")[0]
    expected = start(env, episodes("HabPick-v1")[0])
    start(env, *(episodes("HabPick-v1") if after else ()), held)
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
    assert same(start(env, episodes("HabPick-v1")[0]), expected)
    assert base.privileged()[0].held is None


@pytest.mark.render
@pytest.mark.slow
def test_a_layout_looks_the_same_when_it_comes_again(make, episodes):
    env_id = "HabSetTable-v1"
    first, second, _ = episodes(env_id)
    pictures = []
    for order in ([first], [first, second, first]):
        env = make(env_id, obs_mode="rgb+segmentation")
        for episode in order:
            obs = start(env, episode)
            parts = [c for e in env.unwrapped.scene.sub_scenes[0].entities for c in e.components]
            lamps = [
                part for part in parts if isinstance(part, sapien.render.RenderPointLightComponent)
            ]
            spec = env.unwrapped.simulation.scene_bodies.spec
            assert len(lamps) == min(len(spec.lights), MAX_LIGHTS) > 0
        pictures.append(obs["sensor_data"])
    for name, images in pictures[0].items():
        assert torch.equal(pictures[1][name]["rgb"], images["rgb"]), name
        assert len(torch.unique(images["segmentation"])) > 3
