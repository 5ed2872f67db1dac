"""The optimum of (15) by a plain dense method, to hold every solver against.

Nothing here is shared with `wbc.forces` but the problem and the value of the cost: the derivatives
are written anew, the balance (1) is eliminated by a null-space basis of G, and the first point
comes from a dense phase I. Slow and simple; meant for up to about fifty contacts.
"""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array
from wbc.forces import GraspForceProblem
from wbc.forces.cost import cost, moment_arm

_STEPS = 200


def derivatives(problem: GraspForceProblem, c: Array) -> tuple[Array, Array]:
    """(M,) gradient and (M, M) Hessian of the cost (15) in c, strictly inside."""
    gradient, hessian = np.zeros(problem.size), np.zeros((problem.size, problem.size))
    u = c / problem.scale
    for first, m, mu in zip(problem.first, problem.dims, problem.mu, strict=True):
        own = slice(first, first + m)
        z, weight = u[first + 2], 2.0 * problem.w_bF * mu
        s = u[own].copy()
        s[2] = 0.0
        e = np.zeros(m)
        e[2] = 1.0
        # of z / d with d = z² − |s|²
        d, half = z**2 - s @ s, z * e - s  # half the gradient of d
        sign = np.diag(2.0 * e - 1.0)  # half the Hessian of d
        gradient[own] = 2.0 * problem.w_p * e + weight * (e / d - 2.0 * z * half / d**2)
        hessian[own, own] = weight * (
            -2.0 * (np.outer(e, half) + np.outer(half, e)) / d**2
            - 2.0 * z * sign / d**2
            + 8.0 * z * np.outer(half, half) / d**3
        )
    gradient /= problem.scale
    hessian /= np.outer(problem.scale, problem.scale)
    j = problem.limited
    tau = problem.J.T[j] @ c + problem.tau_e[j]
    low, high = tau - problem.tau_min[j], problem.tau_max[j] - tau
    weight = problem.w_bT * (problem.tau_max - problem.tau_min)[j]
    gradient += problem.J[:, j] @ (weight * (1.0 / high**2 - 1.0 / low**2))
    curvature = 2.0 * weight * (1.0 / high**3 + 1.0 / low**3)
    hessian += (problem.J[:, j] * curvature) @ problem.J[:, j].T
    return gradient, hessian


def balanced(problem: GraspForceProblem) -> tuple[Array, Array]:
    """(M,) one c with G c = h_e (nearest, if G has not full rank), (M, k) all that G maps to 0."""
    rows = np.repeat([1.0, 1.0 / moment_arm(problem)], 3)
    g = rows[:, None] * problem.G * problem.scale
    left, values, right = np.linalg.svd(g)
    rank = int((values > 1e-10 * values[0]).sum())
    own = left[:, :rank].T @ (rows * problem.h_e) / values[:rank]
    return problem.scale * (right[:rank].T @ own), problem.scale[:, None] * right[rank:].T


def optimum(problem: GraspForceProblem, start: Array | None = None) -> Array:
    """(M,) the minimum of Φ (15) with G c = h_e, by damped Newton from a strictly feasible start.

    Args:
        start: (M,) strictly inside and in balance; None: `feasible_start`.

    Raises:
        ValueError: there is no strictly feasible start, or Newton did not converge.
    """
    start = feasible_start(problem) if start is None else start
    if start is None:
        raise ValueError("not feasible")
    particular, null = balanced(problem)
    v = np.linalg.lstsq(null, start - particular, rcond=None)[0]
    for _ in range(_STEPS):
        c = particular + null @ v
        gradient, hessian = derivatives(problem, c)
        step = -_solved(null.T @ hessian @ null, null.T @ gradient)
        slope = float(null.T @ gradient @ step)
        value, length = cost(problem, c), 1.0
        if -slope <= 1e-13 * value:
            # the last full step, where rounding does not tell it from no step
            last = c + null @ step
            return last if cost(problem, last) <= value * (1.0 + 1e-12) else c
        while not (cost(problem, c + length * (null @ step)) <= value + 1e-4 * length * slope):
            length *= 0.5
            if length < 1e-12:
                return c
        v = v + length * step
    raise ValueError("Newton did not converge")


def feasible_start(problem: GraspForceProblem) -> Array | None:
    """(M,) c in balance and strictly inside every cone and limit; None: there is none.

    Phase I: the largest t ≤ 1 with c_z − |s| ≥ t f, and t times half their width between τ and its
    limits, f the size of the load; by path following on the log barrier. Σ c_z is kept below ten
    thousand times the load, for without torque limits the forces have no bound. None also where the
    largest t is below 1e-9.
    """
    found = largest_margin(problem, enough=0.0)
    return None if found is None else found[1]


def largest_margin(
    problem: GraspForceProblem, *, enough: float = np.inf, gap: float = 1e-9
) -> tuple[float, Array] | None:
    """The largest t of `feasible_start` to within `gap`, and its c; None where t ≤ 0.

    Args:
        enough: stop at the first centred point with t above this.
    """
    particular, null = balanced(problem)
    if np.abs(problem.G @ particular - problem.h_e).max() > 1e-9 * np.abs(problem.h_e).max():
        return None  # G has not full rank, and h_e is out of its range
    phase = _Phase(problem, particular, null)
    x, weight = phase.start(), 1.0
    while True:
        x = phase.centre(x, weight)
        c, t = particular + null @ x[:-1], float(x[-1])
        if t > enough:
            return t, c
        if phase.degree / weight < gap or t + phase.degree / weight < 0.0:
            return (t, c) if t > 0.0 else None
        weight *= 10.0


class _Phase:
    """Minimum of −weight t + barrier over x = (v, t), c = particular + null v."""

    def __init__(self, problem: GraspForceProblem, particular: Array, null: Array) -> None:
        self.problem, k = problem, null.shape[1]
        self.load = max(float(np.linalg.norm(problem.h_e)) / problem.contacts, 1e-3)
        scaled, base = null / problem.scale[:, None], particular / problem.scale
        # each cone as rows of an affine map of x, its z less t f
        self.cones = []
        for first, m in zip(problem.first, problem.dims, strict=True):
            matrix = np.zeros((m, k + 1))
            matrix[:, :k] = scaled[first : first + m]
            matrix[2, k] = -self.load
            self.cones.append((matrix, base[first : first + m]))
        # what else must be positive, each a row
        j = problem.limited
        half = 0.5 * (problem.tau_max - problem.tau_min)[j]
        rows = problem.J.T[j] @ null / half[:, None]
        tau = (problem.J.T[j] @ particular + problem.tau_e[j]) / half
        ones = np.ones((len(j), 1))
        most = 1e4 * self.load * problem.contacts + np.abs(base).sum()
        self.rows = np.vstack([
            np.hstack([rows, -ones]), np.hstack([-rows, -ones]),
            np.append(np.zeros(k), -1.0),
            np.append(-scaled[problem.normal].sum(axis=0), 0.0) / most,
        ])  # fmt: skip
        self.offset = np.concatenate([
            tau - problem.tau_min[j] / half, problem.tau_max[j] / half - tau,
            [1.0, 1.0 - base[problem.normal].sum() / most],
        ])  # fmt: skip
        self.degree = 2 * len(self.cones) + len(self.offset)

    def start(self) -> Array:
        """x with v = 0 and t low enough for all."""
        t = 0.0
        for _, base in self.cones:
            s = np.delete(base, 2)
            t = min(t, (base[2] - float(np.linalg.norm(s))) / self.load)
        limits = self.offset[:-2]
        t = min(t, float(limits.min(initial=0.0)))
        return np.append(np.zeros(self.rows.shape[1] - 1), 1.5 * t - 1.0)

    def value(self, x: Array, weight: float) -> float:
        total = -weight * x[-1]
        free = self.rows @ x + self.offset
        if free.min() <= 0.0:
            return np.inf
        for matrix, base in self.cones:
            u = matrix @ x + base
            d = 2.0 * u[2] ** 2 - u @ u
            if u[2] <= 0.0 or d <= 0.0:
                return np.inf
            total -= np.log(d)
        return float(total - np.log(free).sum())

    def derivatives(self, x: Array, weight: float) -> tuple[Array, Array]:
        free = self.rows @ x + self.offset
        gradient = -self.rows.T @ (1.0 / free)
        gradient[-1] -= weight
        hessian = (self.rows.T / free**2) @ self.rows
        for matrix, base in self.cones:
            u = matrix @ x + base
            sign = -np.ones(len(u))
            sign[2] = 1.0
            d, slope = sign @ u**2, 2.0 * sign * u
            gradient -= matrix.T @ slope / d
            inner = np.outer(slope, slope) / d**2 - 2.0 * np.diag(sign) / d
            hessian += matrix.T @ inner @ matrix
        return gradient, hessian

    def centre(self, x: Array, weight: float) -> Array:
        """Damped Newton to the minimum at this weight."""
        for _ in range(_STEPS):
            gradient, hessian = self.derivatives(x, weight)
            step = -_solved(hessian, gradient)
            slope = float(gradient @ step)
            if -slope < 1e-8:
                break
            value, length = self.value(x, weight), 1.0
            while not self.value(x + length * step, weight) <= value + 0.1 * length * slope:
                length *= 0.5
                if length < 1e-10:
                    return x
            x = x + length * step
        return x


def _solved(matrix: Array, right: Array) -> Array:
    """The solution of a positive definite system, rows and columns scaled to a unit diagonal."""
    size = np.sqrt(np.diag(matrix))
    inner: Array = np.linalg.solve(matrix / np.outer(size, size), right / size) / size
    return inner
