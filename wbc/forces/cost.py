"""The cost of the chapter as printed in matrices, and as sums: equations (6)-(16)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wbc.arrays import Array
from wbc.forces.problem import GraspForceProblem
from wbc.forces.solution import ForceStatus, GraspForceSolution


def torques(problem: GraspForceProblem, c: Array) -> Array:
    """(l,) τ = Jᵀ c + τ_e (4), [Nm]."""
    tau: Array = problem.J.T @ c + problem.tau_e
    return tau


def cone_parts(problem: GraspForceProblem, c: Array) -> tuple[Array, Array]:
    """(n,) normal forces c_z and lengths |s| of s = (x/μ, y/μ, t/μ_t), [N]."""
    scaled = c / problem.scale
    z = scaled[problem.normal]
    squares = np.add.reduceat(scaled**2, problem.first) - z**2
    return z, np.sqrt(np.maximum(squares, 0.0))


def cone_margins(problem: GraspForceProblem, c: Array) -> Array:
    """(n,) c_z − |s|, [N]: positive inside (2)-(3), μ and μ_t squared in both."""
    z, s = cone_parts(problem, c)
    return z - s


def torque_margins(problem: GraspForceProblem, c: Array) -> Array:
    """(l,) distance of τ to its nearer limit (10), [Nm]; inf where there is none."""
    tau = torques(problem, c)
    return np.minimum(tau - problem.tau_min, problem.tau_max - tau)


def cost(problem: GraspForceProblem, c: Array) -> float:
    """Φ (15) written out, [N]; inf on and outside the boundary of its domain.

    Φ = Σ_i [2 w_p c_z + 2 w_bF μ_i c_z / (c_z² − |s|²)]
        + Σ_j w_bT (τ_max − τ_min)_j [1 / (τ − τ_min)_j + 1 / (τ_max − τ)_j]
    """
    z, s = cone_parts(problem, c)
    j = problem.limited
    tau = torques(problem, c)[j]
    low, high = tau - problem.tau_min[j], problem.tau_max[j] - tau
    if not (z > s).all() or not (low > 0.0).all() or not (high > 0.0).all():
        return np.inf
    friction = 2.0 * problem.w_p * z + 2.0 * problem.w_bF * problem.mu * z / ((z - s) * (z + s))
    width = low + high
    return float(friction.sum() + problem.w_bT * (width * (1.0 / low + 1.0 / high)).sum())


def friction_matrix(
    problem: GraspForceProblem, c: Array, i: int
) -> NDArray[np.float64] | NDArray[np.complex128]:
    """(2, 2) F_i of contact i, complex Hermitian for a soft finger: (7), (8).

    (8) is printed with √μ and √μ_t, (7) with μ: with the same μ a soft finger would slip. Both are
    built with μ and μ_t.
    """
    k, mu = problem.first[i], problem.mu[i]
    x, y, z = c[k] / mu, c[k + 1] / mu, c[k + 2]
    if problem.dims[i] == 3:
        return np.array([[z + x, y], [y, z - x]])
    assert problem.mu_t is not None
    t = c[k + 3] / problem.mu_t[i]
    return np.array([[z + x, y - 1j * t], [y + 1j * t, z - x]])


def constraint_matrix(problem: GraspForceProblem, c: Array) -> NDArray[np.complex128]:
    """(2n + 2l', 2n + 2l') P = diag(F, T) (6), (9), (11), l' joints with limits; complex."""
    j, n = problem.limited, problem.contacts
    tau = torques(problem, c)[j]
    bounds = np.concatenate([tau - problem.tau_min[j], problem.tau_max[j] - tau])
    p = np.diag(np.concatenate([np.zeros(2 * n), bounds])).astype(np.complex128)
    for i in range(n):
        p[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = friction_matrix(problem, c, i)
    return p


def weights(problem: GraspForceProblem) -> tuple[Array, Array]:
    """Diagonals of W_p and W_b (15)-(16), one entry per row of P.

    As printed W_p weighs the first six rows only and W_b,F has one entry per contact; F has two
    rows per contact, so both are built with w_p I over all 2n rows and μ_i I₂ blocks.
    """
    j = problem.limited
    width = (problem.tau_max - problem.tau_min)[j]
    mu = np.repeat(problem.mu, 2)
    w_p = np.concatenate([np.full(len(mu), problem.w_p), np.zeros(2 * len(width))])
    w_b = np.concatenate([problem.w_bF * mu, problem.w_bT * width, problem.w_bT * width])
    return w_p, w_b


def linear_constraints(problem: GraspForceProblem) -> tuple[Array, Array]:
    """A and b of A ξ(P) = b with ξ = [c, τ_B,L, τ_B,H] (12)-(14), over the joints with limits.

    Rows: the balance (1), then τ − τ_B,L = τ_L and τ + τ_B,H = τ_H with τ_e on the right.
    """
    j = problem.limited
    l_joints, eye = len(j), np.eye(len(j))
    jt, none = problem.J.T[j], np.zeros((len(j), len(j)))
    a = np.block([[problem.G, np.zeros((6, 2 * l_joints))], [jt, -eye, none], [jt, none, eye]])
    b = np.concatenate(
        [problem.h_e, (problem.tau_min - problem.tau_e)[j], (problem.tau_max - problem.tau_e)[j]]
    )
    return a, b


def moment_arm(problem: GraspForceProblem) -> float:
    """Length that makes the moment rows of G comparable to its force rows, [m]."""
    force, moment = np.linalg.norm(problem.G[:3]), np.linalg.norm(problem.G[3:])
    return float(moment / force) if force > 0.0 and moment > 0.0 else 1.0


def balance_error(problem: GraspForceProblem, c: Array) -> float:
    """|G c − h_e| over the largest of |h_e| and |G_i c_i|; moments over `moment_arm`."""
    rows = np.repeat([1.0, 1.0 / moment_arm(problem)], 3)
    g, h = rows[:, None] * problem.G, rows * problem.h_e
    terms = np.add.reduceat(g * c, problem.first, axis=1)
    size = max(float(np.linalg.norm(h)), float(np.linalg.norm(terms, axis=0).max()))
    return float(np.linalg.norm(g @ c - h)) / size if size > 0.0 else 0.0


def solution(
    problem: GraspForceProblem, status: ForceStatus, c: Array, iterations: int,
    *, gap: float = np.nan, load_factor: float = np.nan,
) -> GraspForceSolution:  # fmt: skip
    """The solution with forces c, everything that follows from them evaluated."""
    return GraspForceSolution(
        status=status, c=c, tau=torques(problem, c), phi=cost(problem, c),
        sum_normal=float(c[problem.normal].sum()), cone_margin=cone_margins(problem, c),
        torque_margin=torque_margins(problem, c), balance=balance_error(problem, c),
        iterations=iterations, gap=gap, load_factor=load_factor,
    )  # fmt: skip
