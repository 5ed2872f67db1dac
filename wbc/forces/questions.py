"""The three questions put to the conic kernel: is it feasible, what is the least, how much more."""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array
from wbc.compiled import kernel
from wbc.forces.arrow import back_substitute, cholesky, dot, largest, transposed
from wbc.forces.cones import side
from wbc.forces.conic import NEGATIVE, OPTIMAL, conic
from wbc.forces.interior import Question
from wbc.forces.newton import Constraints

UNRANKED = 4
"""rank G < 6."""

_RANK = 1e-13
_MOST = 50


@kernel
def first_point(given: Constraints, rest: float, u: Array) -> float:
    """Fill u with equal normal forces that leave half of every torque range, if any do.

    They are as large as the wrench asks for or, without one, the force at rest.

    Returns:
        The force, [N].
    """
    contact, tau = given.shape.contact, np.empty(len(given.tau_e))
    n = len(contact) - 1
    for k in range(len(u)):
        u[k] = 0.0
    for i in range(n):
        u[contact[i] + 2] = 1.0
    transposed(given.shape, given.jacobian, u, tau)
    force = max(rest, 2.0 * np.sqrt(dot(given.h, given.h)) / n)
    for j in range(len(tau)):
        up = given.limit[1, j] - given.tau_e[j]
        down = given.tau_e[j] - given.limit[0, j]
        room = up if tau[j] > 0.0 else down
        if tau[j] != 0.0 and room > 0.0:
            force = min(force, 0.5 * room / abs(tau[j]))
    for i in range(n):
        u[contact[i] + 2] = force
    return float(force)


@kernel
def least_squares(gt: Array, h: Array, u: Array) -> bool:
    """Fill u with G⁺ h; False where rank G < 6."""
    s, x = np.zeros((6, 6)), h.copy()
    for i in range(len(u)):
        for k in range(6):
            for j in range(k + 1):
                s[k, j] += gt[i, k] * gt[i, j]
    if not cholesky(s, _RANK):
        return False
    back_substitute(s, x)
    for i in range(len(u)):
        u[i] = dot(x, gt[i])
    return True


@kernel
def phase_one(
    given: Constraints, rest: float, tolerance: float, u: Array
) -> tuple[int, int, float]:
    """A point strictly inside all constraints on G u = h, or the proof that there is none.

    The largest t with every cone margin ≥ t F and every torque margin ≥ t of half its range, F the
    force of `first_point`.

    Returns:
        NEGATIVE (u is such a point, with at least half the largest t up to 1/2), POSITIVE (proven
        infeasible), UNRANKED, OPTIMAL or STALLED (t is 0 to the tolerance); iterations; t.
    """
    contact, l_joints = given.shape.contact, len(given.tau_e)
    n, tau, a = len(contact) - 1, np.empty(l_joints), np.full((2, l_joints), -1.0)
    force = max(first_point(given, rest, u), 1e-3 * largest(given.h))
    if not least_squares(given.gt, given.h, u):
        return UNRANKED, 0, 0.0
    transposed(given.shape, given.jacobian, u, tau)
    p = 0.0
    for i in range(n):
        p = max(p, (side(u, contact[i], contact[i + 1]) - u[contact[i] + 2]) / force)
    for j in range(l_joints):
        low, high = given.limit[0, j], given.limit[1, j]
        if np.isfinite(low):
            half = 0.5 * (high - low)
            a[0, j] = a[1, j] = half
            t = tau[j] + given.tau_e[j]
            p = max(p, max(low - t, t - high) / half)
    ask = Question(np.zeros(len(u)), np.full(n, force), a, np.zeros(6), -1.0, True, True)
    code, used, p, _ = conic(given, ask, tolerance, _MOST, u, p + 1.0)
    return code, used, -p


@kernel
def least_forces(
    given: Constraints, rest: float, tolerance: float, u: Array
) -> tuple[int, int, float]:
    """The exact optimum min Σ c_z on the same constraints, a second-order-cone program.

    Returns:
        OPTIMAL, or what `phase_one` says; iterations; a certified lower bound of Σ c_z.
    """
    contact, l_joints = given.shape.contact, len(given.tau_e)
    n, a, f = len(contact) - 1, np.zeros((2, l_joints)), np.zeros(len(u))
    for i in range(n):
        f[contact[i] + 2] = 1.0
    inside = True
    for j in range(l_joints):
        if np.isfinite(given.limit[0, j]):
            inside &= given.limit[0, j] < given.tau_e[j] < given.limit[1, j]
        else:
            a[0, j] = a[1, j] = -1.0
    ask = Question(f, np.zeros(n), a, np.zeros(6), 0.0, False, False)
    used, most = 0, 16
    for attempt in range(2):
        if attempt == 0 and inside:
            first_point(given, rest, u)
        else:
            code, more, _ = phase_one(given, rest, tolerance, u)
            used += more
            if code != NEGATIVE:
                return code, used, -np.inf
            most = _MOST
        code, more, _, bound = conic(given, ask, tolerance, most, u, 0.0)
        used += more
        if code == OPTIMAL:
            break
    return code, used, bound


@kernel
def most_load(given: Constraints, rest: float, tolerance: float, u: Array) -> float:
    """The largest λ with G c = λ h_e inside all limits; NaN where τ_e alone breaks one.

    In u/λ the torque limits open with 1/λ, which is minimised from a point inside the cones.
    """
    l_joints = len(given.tau_e)
    tau, a, none = np.zeros(l_joints), np.full((2, l_joints), -1.0), np.full((2, l_joints), np.inf)
    if largest(given.h) == 0.0:
        return np.inf
    for j in range(l_joints):
        none[0, j] = -np.inf
        if np.isfinite(given.limit[0, j]):
            a[0, j] = given.tau_e[j] - given.limit[0, j]
            a[1, j] = given.limit[1, j] - given.tau_e[j]
            if not (a[0, j] > 0.0 and a[1, j] > 0.0):
                return np.nan
    free = Constraints(given.shape, given.jacobian, given.gt, tau, none, given.h)
    code, _, _ = phase_one(free, rest, tolerance, u)
    if code != NEGATIVE:
        return 0.0
    transposed(given.shape, given.jacobian, u, tau)
    p = 0.0
    for j in range(l_joints):
        if a[0, j] > 0.0:
            p = max(p, max(-tau[j] / a[0, j], tau[j] / a[1, j]))
        tau[j] = none[0, j] = none[1, j] = 0.0
    if p == 0.0:
        return np.inf
    ask = Question(
        np.zeros(len(u)), np.zeros(len(given.shape.contact) - 1), a, np.zeros(6), 0.0, True, False
    )
    _, _, p, _ = conic(free, ask, tolerance, _MOST, u, 2.0 * p)
    return 1.0 / p if p > 1e-9 else np.inf
