"""Observations that travel between processes."""

import pickle
from dataclasses import replace

import numpy as np
import torch
from hab_eval.packing import ObsPacker, ObsUnpacker

from hab_tasks.privileged import CollisionBody, PrivilegedState


def body(name):
    return CollisionBody(name=name, group="static", shapes=())


def true_state(key, *names, arm=0.0):
    return PrivilegedState(
        scene_key=key,
        bodies=tuple(map(body, names)),
        world_from_body={name: np.eye(4) for name in names},
        world_from_base=np.eye(4),
        arm_qpos=np.full(7, arm),
        locked_qpos={},
        held=None,
        object_com_m={},
        targets=(),
        goals_m=np.zeros((0, 3)),
    )


def sent(packer, unpacker, state):
    """The state as it arrives, and how many bodies its message had."""
    message = packer.pack({"qpos": torch.ones(1, 2), "privileged": [state]})
    bodies = len(message["privileged"][0].bodies)
    obs = unpacker.unpack(pickle.loads(pickle.dumps(message)))
    assert torch.equal(obs["qpos"], torch.ones(1, 2))
    return obs["privileged"][0], bodies


def test_bodies_are_sent_once_a_scene():
    packer, unpacker = ObsPacker(), ObsUnpacker()
    first, count = sent(packer, unpacker, true_state("a", "floor", "table"))
    assert count == 2
    second, count = sent(packer, unpacker, true_state("a", "floor", "table", arm=1.0))
    assert count == 0
    assert second.bodies is first.bodies  # the same tuple until the key changes
    assert second.arm_qpos.tolist() == [1.0] * 7
    third, count = sent(packer, unpacker, true_state("b", "floor"))
    assert count == 1
    assert [one.name for one in third.bodies] == ["floor"]


def test_packing_leaves_the_state_and_other_observations_alone():
    packer, state = ObsPacker(), true_state("a", "floor")
    obs = {"privileged": [state]}
    packer.pack(obs)
    packer.pack(obs)
    assert obs["privileged"][0] is state
    assert len(state.bodies) == 1
    assert ObsUnpacker().unpack(packer.pack(None)) is None
    replaced = replace(state, scene_key="b")
    assert len(packer.pack({"privileged": [replaced]})["privileged"][0].bodies) == 1
