"""Observations that travel between processes."""

import pickle

import numpy as np
import torch
from hab_eval.run.isolation import ObsPacker, ObsUnpacker

from hab_tasks.privileged import CollisionBody, PrivilegedState


def true_state(key, *names, arm=0.0):
    return PrivilegedState(
        scene_key=key,
        bodies=tuple(CollisionBody(name=name, group="static", shapes=()) for name in names),
        world_from_body={name: np.eye(4) for name in names},
        world_from_base=np.eye(4),
        arm_qpos=np.full(7, arm),
        locked_qpos={},
        held=None,
        object_com_m={},
        targets=(),
        goals_m=np.zeros((0, 3)),
    )


def test_bodies_are_sent_once_a_scene():
    packer, unpacker = ObsPacker(), ObsUnpacker()
    arrived = []
    for state, sent in (
        (true_state("a", "floor", "table"), 2),
        (true_state("a", "floor", "table", arm=1.0), 0),
        (true_state("b", "floor"), 1),
    ):
        obs = {"qpos": torch.ones(1, 2), "privileged": [state]}
        message = packer.pack(obs)
        assert len(message["privileged"][0].bodies) == sent
        assert obs["privileged"] == [state]  # unchanged
        got = unpacker.unpack(pickle.loads(pickle.dumps(message)))
        assert torch.equal(got["qpos"], torch.ones(1, 2))
        arrived.append(got["privileged"][0])
    first, second, third = arrived
    assert second.bodies is first.bodies  # the same tuple until the key changes
    assert second.arm_qpos.tolist() == [1.0] * 7
    assert [one.name for one in third.bodies] == ["floor"]
