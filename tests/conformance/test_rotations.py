"""Rotation kernels: round trips near 0, near π and anywhere; derivatives by finite differences."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from conformance.worlds import central_difference, random_rotation, seeded
from wbc.rotations import (
    cross,
    dexp_inverse,
    exp_so3,
    log_jacobian,
    log_so3,
    quaternion,
    rotation_from_quaternion,
    rotation_from_rpy,
    skew,
)

ANGLES = [0.0, 1e-300, 1e-12, 1e-8, 0.9e-6, 1.1e-6, 1e-3, 0.03, 0.1, 1.0, 2.5, 3.1]
NEAR_PI = [np.pi - d for d in (1e-3, 1e-6, 1e-9, 1e-12)]


def axes(angle: float) -> list[np.ndarray]:
    rng = seeded("axes", angle)
    drawn = rng.normal(size=(8, 3))
    return [*np.eye(3), *-np.eye(3), *(a / np.linalg.norm(a) for a in drawn)]


@pytest.mark.parametrize("angle", ANGLES + NEAR_PI)
def test_log_undoes_exp(angle: float) -> None:
    for axis in axes(angle):
        r = exp_so3(angle * axis)
        assert_allclose(r @ r.T, np.eye(3), atol=2e-15)
        assert_allclose(log_so3(r), angle * axis, atol=4e-15, rtol=1e-14)


@pytest.mark.parametrize("angle", [*ANGLES, *NEAR_PI, np.pi, np.pi + 1e-9, 4.0, 6.0])
def test_exp_undoes_log_also_at_half_a_turn(angle: float) -> None:
    for axis in axes(angle):
        r = exp_so3(angle * axis)
        sigma = log_so3(r)
        assert np.linalg.norm(sigma) <= np.pi + 1e-15
        assert_allclose(exp_so3(sigma), r, atol=4e-15)


@pytest.mark.parametrize("angle", ANGLES + NEAR_PI)
def test_exp_and_log_agree_with_pinocchio(angle: float) -> None:
    for axis in axes(angle):
        assert_allclose(exp_so3(angle * axis), pin.exp3(angle * axis), atol=4e-15)
        # Pinocchio's logarithm keeps half the digits near π
        assert_allclose(log_so3(exp_so3(angle * axis)), pin.log3(pin.exp3(angle * axis)), atol=2e-7)


def test_log_of_a_rotation_with_rounding_errors() -> None:
    rng = seeded("rounding")
    for _ in range(50):
        r = random_rotation(rng, False) + 1e-9 * rng.normal(size=(3, 3))
        assert_allclose(exp_so3(log_so3(r)), r, atol=1e-8)


@pytest.mark.parametrize("angle", [a for a in ANGLES if a > 1e-9] + [np.pi - 1e-3, np.pi, 4.0, 6.0])
def test_log_jacobian_is_the_derivative_of_the_rotation_vector(angle: float) -> None:
    """φ(t) with exp(φ(t)) = exp(ω t) exp(φ), past π too: there φ is followed, not the logarithm."""
    for axis in axes(angle):
        phi, w = angle * axis, seeded(angle, *axis).normal(size=3)

        def vector(t: float, phi=phi, w=w) -> np.ndarray:  # type: ignore[no-untyped-def]
            near = log_so3(exp_so3(w * t) @ exp_so3(phi))
            turns = np.round(
                (phi @ near / np.linalg.norm(near) - np.linalg.norm(near)) / (2 * np.pi)
            )
            return near * (1 + 2 * np.pi * turns / np.linalg.norm(near))

        assert_allclose(log_jacobian(phi) @ w, central_difference(vector, 1e-4), atol=1e-9)

        def other_side(t: float, phi=phi, w=w) -> np.ndarray:  # type: ignore[no-untyped-def]
            near = log_so3(exp_so3(phi) @ exp_so3(w * t))
            turns = np.round(
                (phi @ near / np.linalg.norm(near) - np.linalg.norm(near)) / (2 * np.pi)
            )
            return near * (1 + 2 * np.pi * turns / np.linalg.norm(near))

        assert_allclose(log_jacobian(phi).T @ w, central_difference(other_side, 1e-4), atol=1e-9)


def test_log_jacobian_has_no_step_where_its_series_ends() -> None:
    for axis in axes(0.5):
        below, above = np.sqrt(1e-3) * (1 - 1e-9), np.sqrt(1e-3) * (1 + 1e-9)
        assert_allclose(log_jacobian(below * axis), log_jacobian(above * axis), atol=1e-10)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 0.01, 0.1])
def test_dexp_inverse_is_the_rate_of_the_rotation_vector(angle: float) -> None:
    for axis in axes(angle):
        phi, w = angle * axis, seeded(angle, *axis).normal(size=3)
        rate = dexp_inverse(phi, w)
        exact = central_difference(lambda t, p=phi, w=w: log_so3(exp_so3(w * t) @ exp_so3(p)), 1e-3)
        assert_allclose(rate, exact, atol=1e-11 + np.linalg.norm(w) * angle**4 / 720)
        assert_allclose(
            rate, log_jacobian(phi) @ w, atol=1e-15 + np.linalg.norm(w) * angle**4 / 720
        )


def test_cross_skew_and_quaternion() -> None:
    rng = seeded("vectors")
    for _ in range(20):
        a, b = rng.normal(size=(2, 3))
        assert_allclose(cross(a, b), np.cross(a, b), atol=1e-15)
        assert_allclose(skew(a) @ b, np.cross(a, b), atol=1e-15)
        r = random_rotation(rng, False)
        q = quaternion(r)
        assert q[3] >= 0.0 and abs(q @ q - 1.0) < 1e-15
        assert_allclose(rotation_from_quaternion(q), r, atol=4e-15)
        assert_allclose(rotation_from_quaternion(-3.0 * q), r, atol=4e-15)
        assert_allclose(rotation_from_rpy(a), pin.rpy.rpyToMatrix(a), atol=4e-15)
