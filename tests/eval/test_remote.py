"""Policies in other processes: `hab-eval serve`, `hab_eval:remote`, openpi-client and vla-eval."""

import contextlib
import json
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import msgpack
import numpy as np
import pytest
import torch
from hab_eval.cli import main
from hab_eval.integrations.protocols import PROTOCOLS, pack, unpack
from hab_eval.integrations.remote import RemoteAgent, _chunk
from hab_eval.integrations.server import PolicyServer, ServeOptions
from hab_eval.records.results import read_record
from hab_eval.run.agents import StraightAgent
from refusals import check_each, refused_by_call, refused_by_command
from stub_runs import results_of
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from hab_tasks import AgentReport, AgentSpec, agent_setup

ROOT = Path(__file__).resolve().parents[2]
PICK = ("--env", "HabPick-v1", "--seed", 1)
LOCAL = ("run", "--agent", "hab_eval:straight_line", *PICK)
REMOTE = ("run", "--agent", "hab_eval:remote", *PICK)


@contextlib.contextmanager
def served(protocol):
    """A server in this process, on a free port."""
    options = {"agent": "hab_eval:straight_line", "env": "HabPick-v1", "port": 0, "seed": 1}
    server = PolicyServer(ServeOptions(protocol=protocol, **options))
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        yield server
    finally:
        server.close()
        thread.join()


def remote(server, protocol):
    return ("--option", f"address={server.address}", "--option", f"protocol={protocol}")


def tensors(arrays):
    return {name: torch.as_tensor(array)[None] for name, array in arrays.items()}


def test_a_remote_agent_acts_as_in_the_same_process(tmp_path):
    local = (*LOCAL, "--episodes", 2, "--out", tmp_path / "local")
    assert main([*map(str, local)]) == 0
    for protocol in PROTOCOLS:
        out = tmp_path / protocol
        with served(protocol) as server:
            told = (*REMOTE, "--episodes", 2, *remote(server, protocol), "--out", out)
            assert main([*map(str, told)]) == 0
        assert results_of(out) == results_of(tmp_path / "local")
        record = read_record(out / "run.json")
        assert record.agent_name == "Straight line (remote)"
        assert (record.targets, record.control_mode) == ("positions", "ee")
        assert 0 < record.summary.timings_s["server"].mean < 10


class Looking:
    """Acts by what it sees and is told; in its fourth step, it says so or fails."""

    def __init__(self, setup):
        asked = {"obs_mode": "rgb+depth", "targets": "language", "instruction": "stage"}
        asked |= {"cameras": ("head",), "camera_size_px": 32}
        self.spec = AgentSpec(name="Looking", control_mode="ee", **asked)

    def reset(self, mask, seeds):
        self.steps, self.seed = 0, seeds[0]

    def act(self, obs):
        self.steps += 1
        if self.steps == 4:
            raise ZeroDivisionError("the fourth step\nis too much")
        head = obs["sensor_data"]["head"]
        seen = [head["rgb"].float().mean() / 255, head["depth"].mean(), obs["agent"]["is_holding"]]
        told = float(obs["instruction"] == ["Fetch."] and set(obs) == {"agent", "sensor_data"})
        return torch.tensor([[*map(float, seen), told + self.seed]], dtype=torch.float32)

    def report(self):
        return [AgentReport(failure="lost" if self.steps == 3 else None)]


@pytest.mark.parametrize(("protocol", "images"), [("openpi", "raw"), ("vla-eval", "png")])
def test_images_and_instructions_arrive_unchanged(protocol, images, monkeypatch):
    monkeypatch.setattr("hab_eval.straight_line", Looking, raising=False)
    with served(protocol) as server:
        options = {"address": server.address, "protocol": protocol, "images": images}
        agent = RemoteAgent(agent_setup("HabPick-v1", options=options))
        assert agent.spec.name == "Looking (remote)"
        space = agent_setup("HabPick-v1").spaces(agent.spec).observation
        space.seed(0)
        drawn = space.sample()
        head = tensors(drawn["sensor_data"]["head"])
        obs = {"agent": tensors(drawn["agent"]), "sensor_data": {"head": head}}
        obs["instruction"] = ["Fetch."]
        agent.reset(torch.tensor([True]), [7])
        wanted = Looking(None)
        wanted.reset(None, [7])
        for failure in (None, None, "lost"):
            assert torch.equal(agent.act(obs), wanted.act(obs))
            assert agent.report()[0].failure == failure
        refused_by_call(lambda: agent.act(obs), "reports: ZeroDivisionError: the fourth step is")
        # The next episode begins with a new connection.
        agent.reset(torch.tensor([True]), [8])
        agent.act(obs)
        obs["sensor_data"]["head"] = {name: image[:, :8] for name, image in head.items()}
        words = "'images/head'", "uint8 [8, 32, 3]", "[32, 32, 3]"
        refused_by_call(lambda: agent.act(obs), *words)
    agent.reset(torch.tensor([True]), [9])
    agent._reconnect_s = 0.1
    refused_by_call(lambda: agent.act(obs), server.address, "cannot be reached")


def test_finished_episodes_stay_when_the_server_dies(tmp_path, monkeypatch, capfd):
    act, closing = StraightAgent.act, []

    def dying(self, obs):
        closing.append(len(closing))
        if len(closing) == 30:  # in the second episode; the first takes 21 steps
            threading.Thread(target=server.close).start()
            time.sleep(0.5)  # on a busy machine too, the connection is closed before the answer
        return act(self, obs)

    monkeypatch.setattr(StraightAgent, "act", dying)
    with served("openpi") as server:
        told = (*REMOTE, "--episodes", 2, *remote(server, "openpi"), "--out", tmp_path / "run")
        assert main([*map(str, told)]) == 1
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert re.search(r"has closed the connection \(request \d+\)", line)
    assert "1 of 2 episodes are kept" in line


BAD = {
    "absent": ((), "needs --option protocol="),
    "protocol": (("protocol=http",), "'http'", "openpi, vla-eval"),
    "address": (("protocol=openpi", "address=ws://h:1?token=x"), "ws://HOST:PORT"),
    "nobody": (("protocol=openpi", "address=ws://127.0.0.1:9"), "127.0.0.1:9 cannot be reached"),
    "png": (("protocol=openpi", "images=png"), "raw; openpi"),
    "horizon": (("protocol=openpi", "horizon=0"), "--option horizon"),
    "timeout": (("protocol=openpi", "timeout_s=-1"), "--option timeout_s", "-1"),
    "size": (("protocol=openpi", "camera_size_px=big"), "--option camera_size_px", "whole number"),
}


def test_bad_options_are_refused(tmp_path):
    def check(case):
        pairs, *words = case
        options = [word for pair in pairs for word in ("--option", pair)]
        refused_by_command(main, (*REMOTE, *options, "--out", tmp_path / "x"), *words)

    check_each(BAD, check)
    serve = ("serve", "--env", "HabPick-v1", "--agent", "hab_spa:spa_priv", "--protocol")
    refused_by_command(main, (*serve, "grpc"), "'grpc'", "openpi, vla-eval")
    refused_by_command(main, (*serve, "openpi", "--port", 70000), "port is 70000")
    refused_by_command(main, (*serve, "openpi", "--host", "0.0.0.0"), "HAB_REMOTE_TOKEN")
    refused_by_command(main, (*serve, "openpi"), "hab_spa:spa_priv reads the true state")


def test_a_server_asks_for_its_token_and_for_its_environment(monkeypatch):
    monkeypatch.setenv("HAB_REMOTE_TOKEN", "secret")
    with served("vla-eval") as server:
        options = {"address": server.address, "protocol": "vla-eval"}
        RemoteAgent(agent_setup("HabPick-v1", options=options))
        place = agent_setup("HabPlace-v1", options=options)
        refused_by_call(lambda: RemoteAgent(place), '"HabPick-v1"', "HabPlace-v1")
        with connect(f"{server.address}?token=secret", compression=None):
            pass
        with pytest.raises(InvalidStatus), connect(server.address, compression=None):
            pass
        monkeypatch.setenv("HAB_REMOTE_TOKEN", "other")
        refused_by_call(lambda: RemoteAgent(place), "HTTP status 401", "HAB_REMOTE_TOKEN")


def test_only_plain_numbers_of_the_stated_size_are_decoded():
    for protocol in PROTOCOLS:
        kinds = (np.float32, np.float64, np.uint8, np.int64, np.bool_, np.dtype(">f4"))
        sent = {str(k): np.arange(6).reshape(2, 3).astype(k) for k in kinds}
        found = unpack(pack({"a": sent, "b": np.float32(0.5)}, protocol))
        assert all(np.array_equal(found["a"][name], sent[name]) for name in sent)
        assert found["b"] == 0.5
    assert [one.shape for one in _chunk(np.ones((3, 4)))] == [(1, 4)] * 3
    good = {"__ndarray__": True, "data": b"\0" * 8, "dtype": "<f4", "shape": [2]}
    image = {"__image__": True, "format": "jpeg", "data": b"", "shape": [1, 1, 3]}
    cases = {
        "object": ({**good, "dtype": "|O"}, "dtype"),
        "structure": ({**good, "dtype": "i4,i4"}, "dtype"),
        "size": ({**good, "shape": [3]}, "8 bytes, not 12"),
        "huge": ({**good, "shape": [2**40]}, "shape"),
        "negative": ({**good, "shape": [-2, -1]}, "shape"),
        "jpeg": (image, "format"),
        "png": ({**image, "format": "png"}, "cannot be decoded"),
        "scalar": ({"__npgeneric__": True, "data": "x", "dtype": "<f4"}, "number"),
    }
    check_each(cases, lambda c: refused_by_call(lambda: unpack(msgpack.packb([c[0]])), c[1]))
    check_each(
        {"text": "no", "bytes": b"\xc1"}, lambda c: refused_by_call(lambda: unpack(c), "decoded")
    )


def environment_of(folder, *packages, beside=True):
    """Makes a Python of its own with `packages`; `beside` those of this one."""
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    python = folder / "bin" / "python"
    install = [python, "-m", "pip", "install", "-q", "--disable-pip-version-check", *packages]
    if beside:
        (found,) = folder.glob("lib/*/site-packages")
        own = next(path for path in sys.path if path.endswith("site-packages"))
        (found / "own.pth").write_text(f"import site; site.addsitedir({own!r})\n")
        install += ["-c", ROOT / "constraints.txt"]
    if subprocess.run(install, capture_output=True).returncode:
        pytest.skip(f"{packages} cannot be installed here")
    return python


CLIENT = """
import json, sys
import numpy as np
from openpi_client.action_chunk_broker import ActionChunkBroker
from openpi_client.websocket_client_policy import WebsocketClientPolicy
policy = WebsocketClientPolicy(sys.argv[1])
assert policy.get_server_metadata()["env"] == "HabPick-v1"
states = np.load(sys.argv[2])
broker = ActionChunkBroker(policy, action_horizon=1)
print(json.dumps([broker.infer({"state": state})["actions"].tolist() for state in states]))
"""


@pytest.mark.long
def test_openpi_client_is_served(tmp_path):
    # It needs an older numpy than this environment, and does not name all that it imports.
    packages = "openpi-client==0.1.2", "typing_extensions"
    python = environment_of(tmp_path / "venv", *packages, beside=False)
    agent = StraightAgent(agent_setup("HabPick-v1"))
    space = agent_setup("HabPick-v1").spaces(agent.spec).observation
    space.seed(0)
    drawn = [space.sample() for _ in range(5)]
    states = [np.concatenate([*d["agent"].values(), *d["extra"].values()]) for d in drawn]
    np.save(tmp_path / "states.npy", np.stack(states))
    with served("openpi") as server:
        command = [python, "-c", CLIENT, server.address, tmp_path / "states.npy"]
        done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    wanted = [agent.act({group: tensors(d[group]) for group in d})[0].tolist() for d in drawn]
    assert json.loads(done.stdout) == wanted


POLICY = """
import sys
import numpy as np
from vla_eval.model_servers.predict import PredictModelServer
from vla_eval.model_servers.serve import serve


class Straight(PredictModelServer):
    def get_observation_params(self):
        return {"obs_mode": "state_dict", "targets": "positions", "control_mode": "ee"}

    def predict(self, obs, ctx):
        state, holding = obs["state"], obs["state"][16] > 0.5
        assert obs["task_description"].startswith("Pick up the ")
        move = state[17:20] if holding else state[20:23]
        near = np.linalg.norm(move) < 0.12
        move = move / 0.015
        move = move / max(np.linalg.norm(move), 1.0)
        return {"actions": np.array([*move, 1.0 if holding or near else -1.0], dtype=np.float32)}


serve(Straight(), host="127.0.0.1", port=int(sys.argv[1]))
"""

CONFIG = """
server: {{url: "{address}"}}
render: cpu
output_dir: {out}
benchmarks:
  - benchmark: hab_eval.integrations.vla_eval:HabBenchmark
    episodes_per_task: 3
    params: {{tasks: [HabPick-v1], seed: 1}}
"""


@pytest.mark.long
def test_vla_eval_runs_the_benchmark(tmp_path, free_tcp_port):
    python = environment_of(tmp_path / "venv", "vla-eval==0.8.0")

    def harness(address):
        out = tmp_path / str(len(list(tmp_path.iterdir())))
        config = tmp_path / "hab.yaml"
        config.write_text(CONFIG.format(address=address, out=out))
        command = [python.with_name("vla-eval"), "run", "-c", config, "--no-docker", "--yes"]
        done = subprocess.run(command, capture_output=True, text=True)
        (file,) = out.glob("*_aggregate.json")
        (task,) = json.loads(file.read_text())["tasks"]
        assert "Spec mismatch" not in done.stderr
        return [one["metrics"] for one in task["episodes"]]

    assert main([*map(str, (*LOCAL, "--episodes", 3, "--out", tmp_path / "local"))]) == 0
    local = results_of(tmp_path / "local")
    with served("vla-eval") as server:
        found = harness(server.address)
    assert [one["return"] for one in found] == [one["return"] for one in local]
    policy = subprocess.Popen([python, "-c", POLICY, str(free_tcp_port)], stderr=subprocess.PIPE)
    try:
        found = harness(f"ws://127.0.0.1:{free_tcp_port}")  # the harness waits for the server
    finally:
        policy.kill()
        policy.communicate()
    assert [one["success"] for one in found] == [one["success"] for one in local]
    assert all(one["success"] for one in found)
