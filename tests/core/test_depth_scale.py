"""Scaling of ManiSkill's depth images."""

import torch

from hab_tasks.engine.sensors import scale_depth


def test_depth_is_a_share_of_10_m_and_1_beyond_or_without_a_return():
    depth_mm = torch.tensor([1, 2500, 10_000, 30_000, 0], dtype=torch.int16)
    expected = torch.tensor([1e-4, 0.25, 1.0, 1.0, 1.0])
    assert torch.allclose(scale_depth(depth_mm), expected)
