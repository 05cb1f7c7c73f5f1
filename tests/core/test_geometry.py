"""Poses, compared with examples calculated by hand."""

import math

import numpy as np

from hab_tasks.geometry import (
    WORLD_FROM_HABITAT,
    apply,
    compose,
    from_matrix,
    inverse,
    planar,
    pose,
    rotation_between,
    to_matrix,
)

H = math.sqrt(0.5)
QUARTER_ABOUT_Z = (H, 0.0, 0.0, H)


def test_apply_turns_then_shifts():
    # A quarter turn about z maps x to y and y to -x: (1, 0, 0) -> (0, 1, 0) -> (1, 3, 3), and
    # (0, 2, 1) -> (-2, 0, 1) -> (-1, 2, 4). Quaternions are normalised.
    a_from_b = pose((1, 2, 3), (2 * H, 0, 0, 2 * H))
    rows = apply(a_from_b, np.array([[1.0, 0, 0], [0, 2, 1]]))
    assert np.allclose(rows, [(1, 3, 3), (-1, 2, 4)])
    # Habitat's up (0, 1, 0) is the world's (0, 0, 1); its z (towards the viewer) is the world's -y.
    assert np.allclose(apply(WORLD_FROM_HABITAT, np.array([1.0, 2, 3])), (1, -3, 2))
    # 90 degrees at (1, 2): ahead (1, 0, 0) is (0, 1, 0) in the world.
    assert np.allclose(apply(planar(1, 2, math.pi / 2), np.array([1.0, 0, 0.5])), (1, 3, 0.5))


def test_compose_and_inverse_of_quarter_turns():
    quarter = pose((1, 0, 0), QUARTER_ABOUT_Z)
    # The inner shift (1, 0, 0) turns to (0, 1, 0) and adds up to (1, 1, 0); 90 + 90 = 180 degrees.
    assert np.allclose(compose(quarter, quarter), (1, 1, 0, 0, 0, 0, 1))
    # R^T (-t): R^T maps (-1, -2, -3) to (-2, 1, -3), as x' = y and y' = -x.
    assert np.allclose(inverse(pose((1, 2, 3), QUARTER_ABOUT_Z)), (-2, 1, -3, H, 0, 0, -H))


def test_matrices_agree():
    rng = np.random.default_rng(0)
    for a_from_b in (pose(rng.normal(size=3), rng.normal(size=4)) for _ in range(5)):
        point = np.array([0.3, -0.4, 0.5])
        assert np.allclose((to_matrix(a_from_b) @ [*point, 1.0])[:3], apply(a_from_b, point))
        assert np.allclose(to_matrix(from_matrix(to_matrix(a_from_b))), to_matrix(a_from_b))


def test_rotation_between_turns_a_into_b():
    for a, b in (
        ((0, 0, 2), (0, 0, 3)),
        ((1, 0, 0), (-1, 0, 0)),
        ((1, 2, 3), (-3, 1, 0)),
    ):
        turned = apply(pose((0, 0, 0), rotation_between(a, b)), a / np.linalg.norm(a))
        assert np.allclose(turned, b / np.linalg.norm(b), atol=1e-7), (a, b)
