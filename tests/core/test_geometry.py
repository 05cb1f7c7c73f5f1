"""Poses, compared with examples calculated by hand."""

import math

import numpy as np

from hab_tasks import geometry

H = math.sqrt(0.5)
TURNED = geometry.pose((1, 2, 3), (2 * H, 0, 0, 2 * H))
"""A quarter turn about z, which maps x to y and y to -x; quaternions are normalised."""


def test_a_pose_turns_then_shifts_as_its_matrix_does():
    for a_from_b, point, expected in (
        (TURNED, (1, 0, 0), (1, 3, 3)),  # by way of (0, 1, 0)
        (TURNED, (0, 2, 1), (-1, 2, 4)),  # by way of (-2, 0, 1)
        # Habitat's y is up, and its z (towards the viewer) is the world's -y.
        (geometry.WORLD_FROM_HABITAT, (1, 2, 3), (1, -3, 2)),
        # 90 degrees at (1, 2): ahead (1, 0, 0) is (0, 1, 0) in the world.
        (geometry.planar(1, 2, math.pi / 2), (1, 0, 0.5), (1, 3, 0.5)),
    ):
        assert np.allclose(geometry.apply(a_from_b, np.array([point])), expected)
        matrix = geometry.to_matrix(a_from_b)
        assert np.allclose(matrix @ (*point, 1), (*expected, 1))
        assert np.allclose(geometry.to_matrix(geometry.from_matrix(matrix)), matrix)


def test_compose_and_inverse_of_quarter_turns():
    # The inner shift (1, 2, 3) turns to (-2, 1, 3), in all (-1, 3, 6); 90 + 90 = 180 degrees.
    assert np.allclose(geometry.compose(TURNED, TURNED), (-1, 3, 6, 0, 0, 0, 1))
    # R^T (-t): R^T maps (-1, -2, -3) to (-2, 1, -3), as x' = y and y' = -x.
    assert np.allclose(geometry.inverse(TURNED), (-2, 1, -3, H, 0, 0, -H))


def test_rotation_between_turns_a_into_b():
    for a, b in (((0, 0, 2), (0, 0, 3)), ((1, 0, 0), (-1, 0, 0)), ((1, 2, 3), (-3, 1, 0))):
        turn = geometry.pose((0, 0, 0), geometry.rotation_between(a, b))
        turned = geometry.apply(turn, a / np.linalg.norm(a))
        assert np.allclose(turned, b / np.linalg.norm(b), atol=1e-7), (a, b)
