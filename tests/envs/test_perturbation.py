"""Perturbations change what they name, by as much as they say, and nothing else."""

import numpy as np
import pytest
from builders import same
from playing import still
from transforms3d import quaternions

from hab_tasks.episodes.schema import EpisodeRequest
from hab_tasks.episodes.source import open_source
from hab_tasks.errors import OptionError
from hab_tasks.robots.cameras import specified_pose
from hab_tasks.simulator import rigid_body
from hab_tasks.world.scenes.build import LayoutLights


def test_cameras_are_off_by_as_much_as_asked_and_nobody_tells(make):
    options = {"obs_mode": "depth", "num_episodes": 4}
    off = make(perturbation={"camera_m": 0.03, "camera_rad": 0.05}, **options)
    exact = make(**options)
    (seen, _), (usual, _) = (env.reset(options={"episode": 1}) for env in (off, exact))
    assert same(seen["sensor_param"], usual["sensor_param"])
    for name, camera in off.unwrapped._sensors.items():
        error = specified_pose(camera).inv() * camera.local_pose
        assert np.linalg.norm(error.p) == pytest.approx(0.03, abs=1e-5)
        assert quaternions.quat2axangle(error.q)[1] == pytest.approx(0.05, abs=1e-4)
        assert not same(seen["sensor_data"][name], usual["sensor_data"][name])
    # Another episode, another error; the same episode, the same one.
    off.reset(options={"episode": 2})
    again = off.reset(options={"episode": 1})[0]
    assert same(again["sensor_data"], seen["sensor_data"])
    assert same(again["agent"], usual["agent"])


def test_friction_is_that_of_the_objects(make):
    usual, slippery = make(), make(perturbation={"friction": 0.5})
    for env in (usual, slippery):
        env.reset(options={"episode": 0})
        env.step(still(env))
    bodies = [env.unwrapped.simulation.scene_bodies for env in (usual, slippery)]
    for name, actor in bodies[0].movable.items():
        pair = [rigid_body(one).collision_shapes[0] for one in (actor, bodies[1].movable[name])]
        before, after = (shape.physical_material.static_friction for shape in pair)
        assert after == pytest.approx(0.5 * before)
    stage = [rigid_body(one.stage).collision_shapes[0].physical_material for one in bodies]
    assert stage[0].static_friction == stage[1].static_friction


class _Lamps:
    """A scene that keeps the brightest channel of each light."""

    def __init__(self):
        self.brightness = []

    def set_ambient_light(self, color):
        self.brightness.append(max(color))

    def add_directional_light(self, direction, color):
        self.brightness.append(max(color))


def test_lamps_are_as_bright_as_asked():
    usual, bright = _Lamps(), _Lamps()
    LayoutLights(usual)
    LayoutLights(bright, 2.0)
    assert bright.brightness == pytest.approx([2 * one for one in usual.brightness])


@pytest.mark.parametrize("env_id", ["HabPick-v1", "HabPlace-v1", "HabSetTable-v1"])
def test_clutter_leaves_the_rest_of_an_episode_as_it_is(env_id):
    plain, crowded = (open_source(EpisodeRequest(env_id=env_id, clutter=n)) for n in (0, 8))
    for index in range(3):
        before, after = plain.get(index), crowded.get(index)
        assert after.id == before.id
        assert {n: p for n, p in after.objects.items() if n in before.objects} == before.objects
        assert (after.robot, after.targets, after.joints) == (
            before.robot,
            before.targets,
            before.joints,
        )
        added = after.objects.keys() - before.objects.keys()
        assert 3 <= len(added) <= 8
        # On the height of a start or goal: within the largest object, 0.3 m.
        known = [pose[2] for pose in before.objects.values()]
        known += [t.world_from_goal[2] for t in before.targets if t.world_from_goal]
        assert all(min(abs(after.objects[n][2] - z) for z in known) < 0.3 for n in added)


def test_clutter_in_a_closed_fridge_is_refused():
    source = open_source(EpisodeRequest(env_id="HabOpenFridge-v1", clutter=5))
    with pytest.raises(OptionError, match="clutter is 5"):
        source.get(0)
