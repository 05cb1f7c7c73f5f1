"""The hand-over: each skill observes in a task what its own environment gives in that state."""

import gymnasium as gym
import numpy as np
import pytest
from hab_plans.plan import plan_of
from hab_plans.stage import stage_of
from hab_spa.scenes.true_scene import TrueScene
from hab_tp_srl.view import TaskView
from task_states import move_joint, move_object, observe, skill_episode, stand

from hab_tasks.robots.fetch import FETCH

TASK = "HabSetTable-v1"
PLAIN = {"obs_mode": "state_dict", "render_backend": "none", "num_episodes": 1}
TOLERANCE = {False: 2e-5, True: 2e-4}
"""By whether an object is held, whose weight the torso yields to; no episode has the torso [m].
Places are found from float32 landmarks some metres away."""


class Walk:
    """A task's env whose state is set; compares each skill's observation with its own env's."""

    def __init__(self, data):
        self.data, self.rng, self.envs = data, np.random.default_rng(5), {}
        mode = {"control_mode": "joint_target_base", "handle_position": True}
        self.env = gym.make(f"hab_tasks:{TASK}", **PLAIN, **mode, **data)
        obs, _ = self.env.reset(seed=0)
        base = self.env.unwrapped
        stages = [stage_of(base.task, action) for action in plan_of(TASK).interactions]
        self.stages = {stage.skill: stage for stage in reversed(stages)}  # the first with each
        self.views = {truth: TaskView(truth=truth) for truth in (False, True)}
        self.see({**obs, "privileged": base.privileged()})

    def see(self, obs):
        for view in self.views.values():
            view.see(obs, 0)
        self.state = obs["privileged"][0]

    def compare(self, skill, env_id=None, frame="base"):
        """Compares the entries of a skill that begins now; by default in its own env."""
        stage = self.stages[skill]
        env_id = env_id or f"Hab{skill.title().replace('_', '')}-v1"
        if (env_id, frame) not in self.envs:
            handle = "Drawer" in env_id or "Fridge" in env_id
            options = {"target_frame": frame, "handle_position": handle}
            env = gym.make(f"hab_tasks:{env_id}", **PLAIN, **options, **self.data)
            self.envs[env_id, frame] = env
        episode = skill_episode(self.env, env_id, stage)
        obs, _ = self.envs[env_id, frame].reset(options={"episode": episode})
        own = {(g, n): np.asarray(v[0]) for g in ("agent", "extra") for n, v in obs[g].items()}
        assert len(own) >= (2 if "Navigate" in env_id else 6)
        near = TOLERANCE[self.state.held is not None]
        for truth, view in self.views.items():
            given = view.entries(stage, view.point(stage))
            for path, value in own.items():
                message = f"{env_id}: {path}, truth={truth}"
                np.testing.assert_allclose(given[path], value, atol=near, err_msg=message)
                assert (given[path].dtype, given[path].shape) == (value.dtype, value.shape)

    def stand_elsewhere(self):
        """Sets the base to a random pose at which the arm touches nothing."""
        scene, obs = TrueScene(FETCH), {"privileged": [self.env.unwrapped.privileged()[0]]}
        scene.see(obs, 0)
        map_ = scene.floor_map()
        places = map_.positions(np.argwhere(map_.free))
        while True:
            pose = np.array((*self.rng.choice(places), self.rng.uniform(-np.pi, np.pi)))
            if scene.collision(base=pose).is_free(scene.arm_qpos):
                break
        stand(self.env, pose)
        self.see(observe(self.env))

    def grasp(self, number):
        """Brings an object to the hand and closes it."""
        hand = next(p for n, p in self.state.world_from_body.items() if n.endswith("gripper_link"))
        move_object(self.env, self.state.targets[number], hand[:3, 3] + 0.12 * hand[:3, 0])
        action = np.array([*self.state.arm_qpos, 1.0, 0.0, 0.0], dtype=np.float32)
        self.see(observe(self.env, action, steps=2))
        assert self.state.held == self.state.targets[number]


@pytest.mark.parametrize(
    "real", [False, pytest.param(True, marks=[pytest.mark.assets, pytest.mark.slow])]
)
def test_each_skill_observes_in_a_task_what_its_own_environment_gives(real, request):
    """Goes through the states of SetTable in which its skills begin."""
    names = {"scene_dataset": "replica_cad", "objects": "ycb"} if real else {}
    walk = Walk({key: str(request.getfixturevalue(name)) for key, name in names.items()})
    walk.stand_elsewhere()
    walk.compare("open_drawer")
    walk.compare("open_drawer", "HabNavigate-v1")
    walk.compare("open_drawer", "HabNavigate-v1", frame="ee")
    walk.compare("open_fridge")
    move_joint(walk.env, 0, 0.95)
    walk.stand_elsewhere()
    walk.compare("pick")
    walk.compare("close_drawer")
    walk.compare("pick", "HabNavigate-v1")
    move_joint(walk.env, 1, 0.8)
    walk.see(observe(walk.env))
    walk.compare("close_fridge")
    walk.grasp(0)
    walk.compare("place")
    walk.compare("place", frame="ee")
    walk.compare("place", "HabNavigate-v1")
    for env in (walk.env, *walk.envs.values()):
        env.close()
