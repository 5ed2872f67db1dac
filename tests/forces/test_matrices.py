"""The cost as sums against the chapter's matrices, and what was mended in them: (1)-(16)."""

from __future__ import annotations

import numpy as np
import pytest

from wbc.forces import POINT, SOFT_FINGER, GraspForceProblem
from wbc.forces.cost import (
    balance_error,
    cone_margins,
    constraint_matrix,
    cost,
    friction_matrix,
    linear_constraints,
    torque_margins,
    torques,
    weights,
)

from . import reference
from .problems import mixed, two_hands

PROBLEMS = pytest.mark.parametrize(
    "problem",
    [two_hands(POINT, load=1.4), two_hands(SOFT_FINGER, load=1.4), mixed()],
    ids=["points", "soft fingers", "mixed"],
)


@PROBLEMS
def test_cost_is_the_trace(problem: GraspForceProblem) -> None:
    """(15) with (6)-(11) and (16); W_p P has no share of the torques."""
    c = reference.feasible_start(problem)
    assert c is not None
    p = constraint_matrix(problem, c)
    w_p, w_b = weights(problem)
    trace = np.trace(np.diag(w_p) @ p + np.diag(w_b) @ np.linalg.inv(p))
    np.testing.assert_allclose(cost(problem, c), trace.real, rtol=1e-12)
    pressing = np.trace(np.diag(w_p) @ p).real
    np.testing.assert_allclose(pressing, 2.0 * problem.w_p * c[problem.normal].sum())


@PROBLEMS
@pytest.mark.parametrize("seed", range(10))
def test_positive_definite_is_inside(problem: GraspForceProblem, seed: int) -> None:
    """(6), (9), (11): P > 0 exactly where every cone (2)-(3) and limit (5) holds."""
    rng = np.random.default_rng(seed)
    c = reference.optimum(problem) + 0.2 * problem.scale * rng.standard_normal(problem.size)
    inside = cone_margins(problem, c).min() > 0.0 and torque_margins(problem, c).min() > 0.0
    assert (np.linalg.eigvalsh(constraint_matrix(problem, c)).min() > 0.0) == inside
    assert np.isfinite(cost(problem, c)) == inside
    for i, margin in enumerate(cone_margins(problem, c)):
        low = np.linalg.eigvalsh(friction_matrix(problem, c, i)).min()
        np.testing.assert_allclose(low, margin, atol=1e-12)
        k, mu = problem.first[i], problem.mu[i]
        square = (c[k] ** 2 + c[k + 1] ** 2) / mu**2
        if problem.dims[i] == 4:
            assert problem.mu_t is not None
            square += (c[k + 3] / problem.mu_t[i]) ** 2
        assert (margin > 0.0) == (square < c[k + 2] ** 2 and c[k + 2] > 0.0)
    bounds = np.diag(constraint_matrix(problem, c)).real[2 * problem.contacts :]
    np.testing.assert_allclose(bounds.min(), torque_margins(problem, c).min(), rtol=1e-12)


@PROBLEMS
def test_linear_constraints(problem: GraspForceProblem) -> None:
    """(1), (4), (10), (12)-(14): A ξ(P) = b for every c in balance, whatever its torques."""
    particular, null = reference.balanced(problem)
    c = particular + null @ np.random.default_rng(0).standard_normal(null.shape[1])
    tau = torques(problem, c)
    np.testing.assert_allclose(tau, problem.J.T @ c + problem.tau_e)
    a, b = linear_constraints(problem)
    j = problem.limited
    xi = np.concatenate([c, (tau - problem.tau_min)[j], (problem.tau_max - tau)[j]])
    np.testing.assert_allclose(a @ xi, b, atol=1e-9)
    assert balance_error(problem, c) < 1e-12


def test_printed_soft_finger_slips() -> None:
    """(3), (8) have μ where (2), (7) have μ²: with μ = 0.6 a force of 0.77 c_z would pass."""
    problem = two_hands(SOFT_FINGER)
    c = np.zeros(problem.size)
    c[0], c[2] = 0.77, 1.0
    assert c[0] ** 2 / problem.mu[0] <= c[2] ** 2  # (3) as printed
    assert cone_margins(problem, c)[0] < 0.0


def test_printed_weights_miss_contacts() -> None:
    """W_p = diag(w_p I_6, 0) as printed weighs three of ten contacts; here all of them."""
    problem = two_hands()
    w_p, w_b = weights(problem)
    assert (w_p[:20] == problem.w_p).all() and (w_p[20:] == 0.0).all()
    assert (w_b[:20] == problem.w_bF * np.repeat(problem.mu, 2)).all()
