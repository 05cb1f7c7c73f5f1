"""Thresholds at which doors and drawers count as open and as closed (App. H.2)."""

import math

import numpy as np
import pytest
import torch

from hab_tasks.articulations import DRAWER, FRIDGE
from hab_tasks.scenes.markers import HANDLE_MARKERS

KINDS = (torch.tensor, np.array)
every_kind = pytest.mark.parametrize("make", KINDS, ids=["tensors", "arrays"])


@every_kind
def test_the_fridge_is_open_beyond_90_degrees(make):
    joint = make([0.0, math.pi / 2 - 1e-3, math.pi / 2 + 1e-3, 2.3])
    # Its travel does not matter.
    for travel in (1.6, 2.6):
        assert FRIDGE.is_open(joint, joint / travel).tolist() == [False, False, True, True]


@every_kind
def test_the_fridge_is_closed_within_015_rad(make):
    joint = make([0.0, 0.149, 0.151, math.pi / 2, -0.01])
    assert FRIDGE.is_closed(joint).tolist() == [True, True, False, False, True]


@every_kind
def test_a_drawer_is_open_from_90_percent_of_its_travel(make):
    joint, travel = make([0.0, 0.269, 0.271, 0.3, 0.271]), make([0.3, 0.3, 0.3, 0.3, 0.4])
    # 0.271 / 0.4 = 68 %
    assert DRAWER.is_open(joint, joint / travel).tolist() == [False, False, True, True, False]


@every_kind
def test_a_drawer_is_closed_within_5_cm(make):
    assert DRAWER.is_closed(make([0.0, 0.049, 0.051, 0.3])).tolist() == [True, True, False, False]


@every_kind
@pytest.mark.parametrize("kind", [FRIDGE, DRAWER], ids=lambda k: k.name)
def test_nothing_is_open_and_closed(kind, make):
    joint = make(np.linspace(0.0, 2.6, 200).tolist())
    assert not bool((kind.is_open(joint, joint / 2.6) & kind.is_closed(joint)).any())


def test_the_markers_exist():
    assert {FRIDGE.marker, DRAWER.marker} <= {marker.name for marker in HANDLE_MARKERS}
