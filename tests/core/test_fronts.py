"""Thresholds at which doors and drawers count as open and as closed (App. H.2)."""

import math

import numpy as np
import torch

from hab_tasks.articulations import DRAWER, FRIDGE
from hab_tasks.scenes.markers import HANDLE_MARKERS


def kinds_of(*values):
    """The same numbers as a batch of tensors and as one of arrays."""
    return torch.tensor(values), np.array(values)


def test_the_fridge_is_open_beyond_90_degrees_and_closed_within_015_rad():
    for joint in kinds_of(0.0, math.pi / 2 - 1e-3, math.pi / 2 + 1e-3, 2.3):
        for travel in (1.6, 2.6):  # which does not matter
            assert FRIDGE.is_open(joint, joint / travel).tolist() == [False, False, True, True]
    for joint in kinds_of(0.0, 0.149, 0.151, math.pi / 2, -0.01):
        assert FRIDGE.is_closed(joint).tolist() == [True, True, False, False, True]


def test_a_drawer_is_open_from_90_percent_of_its_travel_and_closed_within_5_cm():
    travels = kinds_of(0.3, 0.3, 0.3, 0.3, 0.4)
    for joint, travel in zip(kinds_of(0.0, 0.269, 0.271, 0.3, 0.271), travels, strict=True):
        # 0.271 / 0.4 = 68 %
        assert DRAWER.is_open(joint, joint / travel).tolist() == [False, False, True, True, False]
    for joint in kinds_of(0.0, 0.049, 0.051, 0.3):
        assert DRAWER.is_closed(joint).tolist() == [True, True, False, False]


def test_the_markers_exist():
    assert {FRIDGE.marker, DRAWER.marker} <= {marker.name for marker in HANDLE_MARKERS}
