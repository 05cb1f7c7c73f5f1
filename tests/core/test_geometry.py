"""Poses, compared with examples calculated by hand."""

import math

import numpy as np
import pytest

from hab_tasks.geometry import (
    IDENTITY,
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


def test_pose_normalises_its_quaternion():
    # |(2, 0, 0, 0)| = 2
    assert pose((1, 2, 3), (2, 0, 0, 0)) == (1, 2, 3, 1, 0, 0, 0)


def test_apply_turns_then_shifts():
    a_from_b = pose((1, 2, 3), QUARTER_ABOUT_Z)
    # A quarter turn about z maps x to y and y to -x: (1, 0, 0) -> (0, 1, 0) -> (1, 3, 3).
    assert np.allclose(apply(a_from_b, np.array([1.0, 0, 0])), (1, 3, 3))
    # Rows are mapped one by one: (0, 2, 1) -> (-2, 0, 1) -> (-1, 2, 4).
    rows = apply(a_from_b, np.array([[1.0, 0, 0], [0, 2, 1]]))
    assert np.allclose(rows, [(1, 3, 3), (-1, 2, 4)])


def test_compose_of_two_quarter_turns():
    quarter = pose((1, 0, 0), QUARTER_ABOUT_Z)
    # The inner shift (1, 0, 0) turns to (0, 1, 0) and adds up to (1, 1, 0); 90 + 90 = 180 degrees.
    assert np.allclose(compose(quarter, quarter), (1, 1, 0, 0, 0, 0, 1))


def test_inverse_of_a_quarter_turn():
    # R^T (-t): R^T maps (-1, -2, -3) to (-2, 1, -3), as x' = y and y' = -x.
    assert np.allclose(inverse(pose((1, 2, 3), QUARTER_ABOUT_Z)), (-2, 1, -3, H, 0, 0, -H))


def test_y_up_becomes_z_up():
    # Habitat's up (0, 1, 0) is the world's (0, 0, 1); its z (towards the viewer) is the world's -y.
    assert np.allclose(apply(WORLD_FROM_HABITAT, np.array([0.0, 1, 0])), (0, 0, 1))
    assert np.allclose(apply(WORLD_FROM_HABITAT, np.array([1.0, 2, 3])), (1, -3, 2))


def test_planar_is_a_turn_about_z():
    # 90 degrees at (1, 2): ahead (1, 0, 0) is (0, 1, 0) in the world.
    assert np.allclose(apply(planar(1, 2, math.pi / 2), np.array([1.0, 0, 0.5])), (1, 3, 0.5))


def test_inverse_undoes_and_matrices_agree():
    rng = np.random.default_rng(0)
    for a_from_b in (pose(rng.normal(size=3), rng.normal(size=4)) for _ in range(5)):
        back = compose(inverse(a_from_b), a_from_b)
        assert np.allclose(back[:3], IDENTITY[:3])
        assert abs(back[3]) == pytest.approx(1.0)
        point = np.array([0.3, -0.4, 0.5])
        assert np.allclose((to_matrix(a_from_b) @ [*point, 1.0])[:3], apply(a_from_b, point))
        assert np.allclose(to_matrix(from_matrix(to_matrix(a_from_b))), to_matrix(a_from_b))


def test_rotation_between_turns_a_into_b():
    for a, b in (
        ((0, 1, 0), (0, 0, 1)),
        ((0, 0, 2), (0, 0, 3)),
        ((1, 0, 0), (-1, 0, 0)),
        ((1, 2, 3), (-3, 1, 0)),
    ):
        turned = apply(pose((0, 0, 0), rotation_between(a, b)), a / np.linalg.norm(a))
        assert np.allclose(turned, b / np.linalg.norm(b), atol=1e-7), (a, b)
