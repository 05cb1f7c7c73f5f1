"""LeRobot: the environment here, and plugin, data sets and training in a Python of its own."""

import json
import os
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pytest
from hab_eval.cli import main as hab_eval
from hab_eval.integrations.lerobot import HabLeRobotEnv
from hab_eval.records.config import EvalConfig
from hab_eval.records.results import read_record
from hab_spa.cli import main as hab_spa
from test_tutorials import steps_of

from hab_tasks.agent import AgentSpec

ENV = "HabPick-v1"
TUTORIAL = Path(__file__).parents[2] / "docs/tutorials/imitation.md"
PYTHON = os.environ.get("HAB_LEROBOT_PYTHON")
CAMERA = {"cameras": ("third_person",), "camera_size_px": 32}


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Two episodes of the straight-line agent, with images."""
    folder = tmp_path_factory.mktemp("recording")
    agent = ("--agent", "hab_eval:straight_line", "--env", "HabPick-v1", "--split", "test")
    images = ("--lerobot", "--obs-mode", "rgb", "--cameras", "third_person", "--camera-size", "32")
    told = ("--targets", "language", "--out", str(folder))
    assert hab_spa(["record", *agent, *images, "--count", "2", *told]) == 0
    return folder


@pytest.fixture(scope="module")
def plan(recording):
    """Number, instruction and actions of the recorded episodes."""
    episodes = json.loads((recording / "trajectory.json").read_text())["episodes"]
    with h5py.File(recording / "trajectory.h5") as file:
        return [
            {
                "seed": one["reset_kwargs"]["options"]["episode"],
                "task": one["task"],
                "actions": file[f"traj_{one['episode_id']}/actions"][:].tolist(),
            }
            for one in episodes
        ]


@pytest.mark.slow
@pytest.mark.render
def test_the_seed_is_the_number_of_the_episode(plan):
    config = EvalConfig(agent="lerobot", env="HabPick-v1", split="test")
    told = {"obs_mode": "rgb", "targets": "language", "instruction": "task"}
    env = HabLeRobotEnv(config, AgentSpec(name="LeRobot", control_mode="ee", **told, **CAMERA))
    assert env._max_episode_steps == 200
    for one in reversed(plan):
        obs, info = env.reset(seed=one["seed"])
        assert env.task_description == one["task"]
        for action in one["actions"]:
            assert obs in env.observation_space
            assert info == {"is_success": False}
            obs, _, terminated, _, info = env.step(np.array(action))
        assert terminated
        assert info == {"is_success": True}
    assert np.array_equal(env.render(), obs["pixels"]["third_person"])
    env.close()


def in_lerobot(*arguments, **options):
    """Runs LeRobot's Python; skips where there is none."""
    if PYTHON is None:
        pytest.skip("HAB_LEROBOT_PYTHON names no Python with lerobot (docs/tutorials/imitation.md)")
    done = subprocess.run([PYTHON, *map(str, arguments)], capture_output=True, text=True, **options)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


PLAY = """
import json, sys
import numpy as np
from lerobot.envs.factory import make_env, make_env_config
from lerobot.envs.utils import env_to_policy_features, preprocess_observation
from lerobot.utils.import_utils import register_third_party_plugins

register_third_party_plugins()
plan = json.load(open(sys.argv[1]))
cfg = make_env_config("hab", task="HabPick-v1", split="test", cameras="third_person",
                      camera_size_px=32, control_mode="ee")
features = env_to_policy_features(cfg)
made = [make_env(cfg, n_envs=2, use_async_envs=use) for use in (False, True)]
for envs in made:
    env = envs["hab"][0]
    obs, _ = env.reset(seed=[one["seed"] for one in plan])
    seen = preprocess_observation(obs)
    for name, feature in features.items():
        if name != "action":
            assert seen[name].shape == (2, *feature.shape), name
    assert list(env.call("task_description")) == [one["task"] for one in plan]
    solved = [False, False]
    for step in range(max(len(one["actions"]) for one in plan)):
        rows = [one["actions"][min(step, len(one["actions"]) - 1)] for one in plan]
        *_, info = env.step(np.array(rows, dtype=np.float32))
        if "final_info" in info:
            solved = [bool(a or b) for a, b in zip(solved, info["final_info"]["is_success"])]
    print(json.dumps(solved))
    env.close()
"""


@pytest.mark.long
@pytest.mark.render
def test_lerobots_factory_makes_the_environments(plan, tmp_path):
    (tmp_path / "plan.json").write_text(json.dumps(plan))
    assert in_lerobot("-c", PLAY, tmp_path / "plan.json") == "[true, true]\n" * 2


READ = """
import sys
from lerobot.datasets.lerobot_dataset import LeRobotDataset

data = LeRobotDataset("hab/pick", root=sys.argv[1])
for index in range(len(data)):
    frame = data[index]
    assert frame["observation.images.third_person"].shape == (3, 32, 32)
    assert frame["subtask"] == frame["task"]
print(len(data), data.num_episodes)
"""


@pytest.mark.long
@pytest.mark.render
def test_lerobot_reads_a_recording(recording, plan):
    frames = sum(len(one["actions"]) for one in plan)
    assert in_lerobot("-c", READ, recording / "lerobot") == f"{frames} 2\n"


TRAIN = """
--dataset.repo_id=hab/pick --policy.type=act --policy.chunk_size=20 --policy.n_action_steps=10
--policy.device=cpu --policy.pretrained_backbone_weights=null --policy.push_to_hub=false
--policy.dim_model=32 --policy.dim_feedforward=32 --batch_size=2 --steps=1 --num_workers=0
"""
EVALUATE = """
--env.type=hab --env.task=HabPick-v1 --env.split=test --env.control_mode=ee --seed=0
--env.cameras=third_person --env.camera_size_px=32 --eval.n_episodes=1 --eval.batch_size=1
"""


@pytest.mark.long
@pytest.mark.render
def test_act_is_trained_evaluated_and_served(recording, tmp_path, free_tcp_port):
    """The tutorial with an update of a small network; its agent plays an episode here."""
    runs = ("-m", "lerobot.scripts.lerobot_train", f"--dataset.root={recording / 'lerobot'}")
    in_lerobot(*runs, *TRAIN.split(), f"--output_dir={tmp_path / 'act'}")
    weights = tmp_path / "act/checkpoints/last/pretrained_model"
    policy = (f"--policy.path={weights}", f"--output_dir={tmp_path / 'eval'}")
    in_lerobot("-m", "lerobot.scripts.lerobot_eval", *policy, *EVALUATE.split())
    info = json.loads((tmp_path / "eval/eval_info.json").read_text())
    assert info["overall"]["n_episodes"] == 1

    (code,) = (c for _, _, file, c in steps_of(TUTORIAL) if file == "act_agent.py")
    (tmp_path / "act_agent.py").write_text(code.replace('"joint_target"', '"ee"'))
    serve = [PYTHON, "-m", "hab_eval", "serve", "--agent", "act_agent:ActAgent", "--env", ENV]
    serve += ["--protocol", "openpi", "--option", f"checkpoint={weights}"]
    server = subprocess.Popen(
        [*serve, "--port", str(free_tcp_port)], cwd=tmp_path, stdout=subprocess.PIPE
    )
    try:
        assert any(line.startswith(b"serving ACT") for line in server.stdout)
        remote = ("--option", f"address=ws://127.0.0.1:{free_tcp_port}")
        run = ("run", "--agent", "hab_eval:remote", "--env", ENV, "--episodes", "1", *remote)
        out = ("--option", "protocol=openpi", "--out", str(tmp_path / "run"))
        assert hab_eval([*run, *out]) == 0
    finally:
        server.kill()
        server.communicate()
    assert read_record(tmp_path / "run/run.json").agent_name == "ACT (remote)"
