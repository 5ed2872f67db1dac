"""What the gradient flows of the chapter are made of: the cost, its slope, projectors, a step.

Everything is in u = (x/μ, y/μ, z, t/μ_t), where each friction cone is z ≥ |s|, and in the
coordinates ξ(P) = (√2 u, b), b the distances of the torques to their limits (10). There
tr(X Y) = ξ(X) · ξ(Y), so that ξ(P⁻¹ W_b P⁻¹ − W_p) is the downhill gradient of Φ (15) and the flow
(17) a gradient flow. With c itself in ξ, as printed, it is not, for μ ≠ 1: the direction is not
downhill, and the flow stops elsewhere than at the optimum.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray
from wbc.compiled import kernel
from wbc.forces.cost import moment_arm
from wbc.forces.problem import GraspForceProblem

ROOT2 = float(np.sqrt(2.0))
_HALVINGS = 60
_EIGEN = 1e-12  # of G Gᵀ, relative: below it the rank is less than 6

_SHORTER = 0.9  # of the best step: without it steepest descent goes from side to side

FLOW18, FLOW19, FLOW20 = 18, 19, 20
DONE, MOST_STEPS, STALE, RANK, STUCK = 0, 1, 2, 3, 4
"""How a method ended: optimal, out of steps, start outside, rank G < 6, γ < 1 for good."""


class Fixed(NamedTuple):
    """What does not change from tick to tick.

    Attributes:
        first: (n+1,) where each contact begins in u, and the end.
        scale: (M,) c = scale u.
        cone: (n,) 2 w_bF μ, weight of each cone's barrier (16).
        press: 2 w_p, weight of each normal force.
        joint: (k,) joint of each bound: first all lower, then all upper bounds.
        sign: (k,) + 1 for a lower, − 1 for an upper bound.
        limit: (k,) the limit, [Nm].
        barrier: (k,) weight of each bound's barrier (16).
        arm: length that the moment rows of G are divided by, [m].
    """

    first: IntArray
    scale: Array
    cone: Array
    press: float
    joint: IntArray
    sign: Array
    limit: Array
    barrier: Array
    arm: float


class Tick(NamedTuple):
    """What changes: G (6, M), J (M, l), τ_e (l,), h_e (6,) of `GraspForceProblem`."""

    G: Array
    J: Array
    tau_e: Array
    h_e: Array


class Rows(NamedTuple):
    """A tick in u: g u = h is the balance (1), b u + free > 0 are the bounds (10)."""

    g: Array
    h: Array
    b: Array
    free: Array


def fixed(problem: GraspForceProblem) -> Fixed:
    """The constant part of a problem."""
    j = problem.limited
    width = (problem.tau_max - problem.tau_min)[j]
    return Fixed(
        first=np.append(problem.first, problem.size),
        scale=np.array(problem.scale),
        cone=2.0 * problem.w_bF * problem.mu,
        press=2.0 * problem.w_p,
        joint=np.concatenate([j, j]),
        sign=np.repeat([1.0, -1.0], len(j)),
        limit=np.concatenate([problem.tau_min[j], problem.tau_max[j]]),
        barrier=problem.w_bT * np.concatenate([width, width]),
        arm=moment_arm(problem),
    )


def tick(problem: GraspForceProblem) -> Tick:
    """The changing part of a problem."""
    return Tick(problem.G, problem.J, problem.tau_e, problem.h_e)


class Tracked(NamedTuple):
    """Where a method ended: u (M,), γ of (21), steps taken, and how, one of the codes above."""

    u: Array
    gamma: float
    steps: int
    code: int


@kernel
def assemble(fix: Fixed, now: Tick) -> Rows:
    """The linear parts of a tick, of all bounds."""
    m, k = len(fix.scale), len(fix.joint)
    g, h = np.empty((6, m)), np.empty(6)
    b, free = np.empty((k, m)), np.empty(k)
    for r in range(6):
        row = 1.0 if r < 3 else 1.0 / fix.arm
        h[r] = row * now.h_e[r]
        for i in range(m):
            g[r, i] = row * now.G[r, i] * fix.scale[i]
    for q in range(k):
        j, sign = fix.joint[q], fix.sign[q]
        free[q] = sign * (now.tau_e[j] - fix.limit[q])
        for i in range(m):
            b[q, i] = sign * now.J[i, j] * fix.scale[i]
    return Rows(g, h, b, free)


@kernel
def picked(rows: Rows, active: BoolArray) -> Rows:
    """The same with the active bounds only."""
    return Rows(rows.g, rows.h, rows.b[active], rows.free[active])


@kernel
def phi(fix: Fixed, barrier: Array, u: Array, slack: Array) -> float:
    """Φ (15) with the bounds whose distances are `slack`; inf outside and on the boundary."""
    total = 0.0
    for i in range(len(fix.cone)):
        z, d = u[fix.first[i] + 2], 0.0
        for a in range(fix.first[i], fix.first[i + 1]):
            d -= u[a] ** 2
        d += 2.0 * z**2
        if not (z > 0.0 and d > 0.0):
            return np.inf
        total += fix.press * z + fix.cone[i] * z / d
    for q in range(len(slack)):
        if not slack[q] > 0.0:
            return np.inf
        total += barrier[q] / slack[q]
    return total


@kernel
def downhill(fix: Fixed, barrier: Array, u: Array, slack: Array, xi: Array) -> None:
    """ξ(P⁻¹ W_b P⁻¹ − W_p) (17) into xi (M + k,): minus the gradient of Φ in ξ."""
    for i in range(len(fix.cone)):
        first, end = fix.first[i], fix.first[i + 1]
        z, d = u[first + 2], 0.0
        for a in range(first, end):
            d -= u[a] ** 2
        d += 2.0 * z**2
        factor = 2.0 * fix.cone[i] * z / d**2
        for a in range(first, end):
            xi[a] = -factor * u[a] / ROOT2
        xi[first + 2] = (factor * z - fix.cone[i] / d - fix.press) / ROOT2
    for q in range(len(slack)):
        xi[len(u) + q] = barrier[q] / slack[q] ** 2


@kernel
def full_rank(g: Array) -> bool:
    """Whether the six rows of g are independent."""
    values = np.linalg.eigvalsh(g @ g.T)
    return bool(values[0] > _EIGEN * values[-1])


@kernel
def lifting(g: Array, inverse: Array) -> Array:
    """(M, 6) G^# = W_G⁻¹ Gᵀ (G W_G⁻¹ Gᵀ)⁻¹ (23), `inverse` the diagonal of W_G⁻¹.

    Printed without the transpose of the first G.
    """
    half = g * inverse
    lift: Array = np.linalg.solve(half @ g.T, half).T.copy()
    return lift


@kernel
def projector(method: int, printed: bool, g: Array, b: Array) -> Array:
    """(M, M + k) the rows of Q (17), or of Q̄ (20), that give the change of u from ξ."""
    m, k = g.shape[1], b.shape[0]
    if method != FLOW20:
        a = np.zeros((6 + k, m + k))
        a[:6, :m] = g / ROOT2
        a[6:, :m] = b / ROOT2
        for q in range(k):
            a[6 + q, m + q] = -1.0
        return _null(a)[:m] / ROOT2
    balance = _null(g)
    if k == 0:
        return balance
    a = np.zeros((k, m + k))
    a[:, :m] = b / ROOT2
    for q in range(k):
        a[q, m + q] = -1.0
    coherent = _null(a)[:m]
    if printed:
        return balance @ coherent
    both = balance @ (np.ascontiguousarray(coherent[:, :m]) @ balance)
    return np.hstack((ROOT2 * both, both @ b.T))


@kernel
def _null(a: Array) -> Array:
    """I − A† A, A of full row rank."""
    onto: Array = a.T @ np.linalg.solve(a @ a.T, a)
    return np.eye(len(onto)) - onto


@kernel
def dikin_norm(fix: Fixed, u: Array, slack: Array, du: Array, db: Array) -> float:
    """tr(P⁻¹ X P⁻¹ X), ‖X‖²_P of (19), of the change of P that (du, db) makes."""
    total = 0.0
    for i in range(len(fix.cone)):
        first, end = fix.first[i], fix.first[i + 1]
        d, e, inner = 0.0, 0.0, 0.0
        for a in range(first, end):
            sign = 1.0 if a == first + 2 else -1.0
            d += sign * u[a] ** 2
            e += sign * du[a] ** 2
            inner += sign * u[a] * du[a]
        total += 4.0 * (inner / d) ** 2 - 2.0 * e / d
    for q in range(len(slack)):
        total += (db[q] / slack[q]) ** 2
    return total


@kernel
def _along(
    fix: Fixed, barrier: Array, u: Array, slack: Array, du: Array, db: Array, length: float
) -> tuple[float, float]:
    """dΦ/dα and d²Φ/dα² at u + α du, α = length; inf, inf outside."""
    slope, bend = 0.0, 0.0
    for i in range(len(fix.cone)):
        first, end = fix.first[i], fix.first[i + 1]
        d, d1, d2 = 0.0, 0.0, 0.0
        for a in range(first, end):
            sign = 1.0 if a == first + 2 else -1.0
            here = u[a] + length * du[a]
            d += sign * here**2
            d1 += 2.0 * sign * here * du[a]
            d2 += 2.0 * sign * du[a] ** 2
        z, dz = u[first + 2] + length * du[first + 2], du[first + 2]
        if not (z > 0.0 and d > 0.0):
            return np.inf, np.inf
        slope += fix.press * dz + fix.cone[i] * (dz / d - z * d1 / d**2)
        bend += fix.cone[i] * (2.0 * z * d1**2 / d - 2.0 * dz * d1 - z * d2) / d**2
    for q in range(len(slack)):
        here = slack[q] + length * db[q]
        if not here > 0.0:
            return np.inf, np.inf
        part = barrier[q] * db[q] / here**2
        slope -= part
        bend += 2.0 * part * db[q] / here
    return slope, bend


@kernel
def search(
    fix: Fixed, barrier: Array, u: Array, slack: Array, du: Array, db: Array, longest: float
) -> float:
    """α in [0, longest] that minimises Φ (u + α du), to a percent of its slope; 0: not downhill.

    Φ is convex along the line: Newton's method on its slope, halving where it leaves the bracket.
    """
    first, bend = _along(fix, barrier, u, slack, du, db, 0.0)
    if not first < 0.0:
        return 0.0
    low, high = 0.0, longest
    length = min(-first / bend, longest)
    for _ in range(_HALVINGS):
        slope, bend = _along(fix, barrier, u, slack, du, db, length)
        if abs(slope) <= 1e-2 * -first or (slope < 0.0 and length == longest):
            return length
        if slope < 0.0:
            low = length
        else:
            high = length
        length -= slope / bend if np.isfinite(slope) else 0.0
        if not low < length < high:
            length = 0.5 * (low + high) if np.isfinite(high) else 2.0 * low
            if low < longest < length:
                length = longest
    return low


@kernel
def flow(
    fix: Fixed, rows: Rows, barrier: Array, u: Array, method: int, printed: bool,
    tolerance: float, most: int,
) -> tuple[Array, bool, int]:  # fmt: skip
    """Steps of (18), (19) or (20) from u (M,) inside: the end, whether optimal, steps taken."""
    q = projector(method, printed, rows.g, rows.b)
    lift = lifting(rows.g, np.ones(len(u)))
    slack = rows.b @ u + rows.free
    value = phi(fix, barrier, u, slack)
    xi = np.empty(len(u) + len(slack))
    longest = np.inf
    for step in range(most):
        downhill(fix, barrier, u, slack, xi)
        du = q @ xi
        du -= lift @ (rows.g @ du)  # at the optimum du is the rounding of q ξ, out of balance
        db = rows.b @ du
        if method == FLOW19:
            norm = dikin_norm(fix, u, slack, du, db)
            if not norm > 0.0:
                return u, True, step
            factor = -1.0 / norm if printed else 1.0 / np.sqrt(norm)
            du, db, longest = factor * du, factor * db, 1.0
        length = _SHORTER * search(fix, barrier, u, slack, du, db, longest)
        there, room = u + length * du, slack + length * db
        reached = phi(fix, barrier, there, room)
        if not reached < value:
            return u, not printed, step
        u, slack = there, room
        if value - reached <= tolerance * value:
            return u, True, step + 1
        value = reached
    return u, False, most
