"""The reference that other tests trust: its derivatives, its optimum, and its verdicts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from wbc.arrays import Array
from wbc.forces import POINT, SOFT_FINGER, GraspForceProblem
from wbc.forces.cost import balance_error, cone_margins, cost, torque_margins

from . import reference
from .problems import random_grasp, two_hands


@pytest.mark.parametrize("model", [POINT, SOFT_FINGER])
def test_derivatives(model: str) -> None:
    problem = two_hands(model, load=1.4)
    c = reference.feasible_start(problem)
    assert c is not None
    gradient, hessian = reference.derivatives(problem, c)
    step = 1e-6 * problem.scale * np.random.default_rng(0).standard_normal(problem.size)
    rise = cost(problem, c + step) - cost(problem, c - step)
    np.testing.assert_allclose(rise, 2.0 * gradient @ step, rtol=1e-6)
    turn = reference.derivatives(problem, c + step)[0] - reference.derivatives(problem, c - step)[0]
    np.testing.assert_allclose(turn, 2.0 * hessian @ step, rtol=1e-4, atol=1e-9 * abs(turn).max())


@pytest.mark.parametrize("seed", range(20))
def test_optimum(seed: int) -> None:
    problem = random_grasp(np.random.default_rng(seed))
    start = reference.feasible_start(problem)
    if start is None:
        assert not _pyramids_feasible(problem, 64)
        return
    assert balance_error(problem, start) < 1e-10
    assert cone_margins(problem, start).min() > 0.0 and torque_margins(problem, start).min() > 0.0
    c = reference.optimum(problem, start)
    assert balance_error(problem, c) < 1e-10
    gradient, hessian = reference.derivatives(problem, c)
    null = reference.balanced(problem)[1]
    left = null.T @ gradient
    assert left @ np.linalg.solve(null.T @ hessian @ null, left) < 1e-15 * cost(problem, c)


def _pyramids_feasible(problem: GraspForceProblem, sides: int) -> bool:
    """Whether some c balances within limits and inside pyramids that lie within the cones."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    rows: list[Array] = []
    for i, first in enumerate(problem.first):
        turns = [(x, y, 0.0) for x, y in zip(np.cos(angle), np.sin(angle), strict=True)]
        if problem.dims[i] == 4:
            turns = [(x * k, y * k, r) for x, y, _ in turns
                     for k, r in ((1.0, 0.0), (0.7, 0.7), (0.7, -0.7))]  # fmt: skip
        for x, y, t in turns:
            row = np.zeros(problem.size)
            row[first : first + 3] = x, y, -np.cos(np.pi / sides) if problem.dims[i] == 3 else -0.5
            if problem.dims[i] == 4:
                row[first + 3] = t
            rows.append(row / problem.scale)
    limits = np.concatenate([problem.tau_max - problem.tau_e, problem.tau_e - problem.tau_min])
    found = linprog(
        np.zeros(problem.size), A_ub=np.vstack([rows, problem.J.T, -problem.J.T]),
        b_ub=np.concatenate([np.zeros(len(rows)), limits]),
        A_eq=problem.G, b_eq=problem.h_e, bounds=(None, None),
    )  # fmt: skip
    return bool(found.status == 0)
