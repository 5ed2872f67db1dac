"""Rows over the joints: what a task wants of q̃ = [q, ξ], once ξ̇ follows from q̇."""

from __future__ import annotations

import numpy as np
import pytest

from stack.problems import seeded
from wbc.stack.projection import task_rows

NV, XI = 6, 4
SIZES = (1, 3, 2, 1)
ROWS = sum(SIZES)


def reduce(rng, jacobian_ext, error, rate, gain, saturation, scale=None):  # type: ignore[no-untyped-def]
    """(J, r) with random contacts, and the contacts."""
    size = np.array(SIZES, dtype=np.int64)
    xi_jacobian, xi_drift = rng.normal(size=(XI, NV)), rng.normal(size=XI)
    scale = np.ones(NV) if scale is None else scale
    jacobian, rhs = np.full((ROWS, NV), np.nan), np.full(ROWS, np.nan)
    task_rows(
        jacobian_ext, error, rate, gain, saturation, np.cumsum(size) - size, size, xi_jacobian,
        xi_drift, scale, jacobian, rhs,
    )  # fmt: skip
    return jacobian, rhs, xi_jacobian, xi_drift


def test_fulfilling_the_rows_gives_the_task_its_rate():
    """For any q̇ with J q̇ = r, J_q q̇ + J_ξ ξ̇ = K e + σ̇_d with the ξ̇ that the contacts make of it."""
    rng = seeded("rate")
    ext, error, rate = (
        rng.normal(size=(ROWS, NV + XI)),
        rng.normal(size=ROWS),
        rng.normal(size=ROWS),
    )
    gain, metric = np.array([1.0, 20.0, 5.0, 0.3]), rng.uniform(0.2, 5.0, NV)
    scale = 1.0 / np.sqrt(metric)
    jacobian, rhs, xi_jacobian, xi_drift = reduce(
        rng, ext, error, rate, gain, np.full(4, np.inf), scale
    )
    for _ in range(5):
        scaled = rng.normal(size=NV)
        v = scaled * scale
        xi_rate = xi_jacobian @ v + xi_drift
        wanted = np.repeat(gain, SIZES) * error + rate
        left = ext[:, :NV] @ v + ext[:, NV:] @ xi_rate - wanted
        np.testing.assert_allclose(jacobian @ scaled - rhs, left, atol=1e-12)


@pytest.mark.parametrize("bound", [0.0, 1e-3, 0.5, 10.0, np.inf])
def test_errors_are_saturated_along_their_direction(bound):
    """|K e| ≤ K · saturation, level by level; the target's rate is not."""
    rng = seeded("saturation", bound)
    ext, error, rate = np.zeros((ROWS, NV + XI)), rng.normal(size=ROWS), rng.normal(size=ROWS)
    error[0] = 0.0
    gain = np.array([2.0, 20.0, 5.0, 0.3])
    _, rhs, _, _ = reduce(rng, ext, error, rate, gain, np.full(4, bound))
    for k, (a, m) in enumerate(zip(np.cumsum(SIZES) - SIZES, SIZES, strict=True)):
        term, e = (rhs - rate)[a : a + m], error[a : a + m]
        length = np.linalg.norm(e)
        assert np.isfinite(term).all()
        np.testing.assert_allclose(
            term, gain[k] * e * min(1.0, bound / max(length, 1e-300)), atol=1e-13
        )


def test_saturation_is_continuous_at_its_bound():
    rng = seeded("continuous")
    ext = np.zeros((ROWS, NV + XI))
    error = rng.normal(size=ROWS)
    one = np.ones(4)
    bound = np.array(
        [np.linalg.norm(error[a : a + m]) for a, m in zip((0, 1, 4, 6), SIZES, strict=True)]
    )
    low, high = (
        reduce(seeded("x"), ext, error, np.zeros(ROWS), one, bound * (1 + e))[1]
        for e in (-1e-9, 1e-9)
    )
    np.testing.assert_allclose(low, high, atol=1e-8)
