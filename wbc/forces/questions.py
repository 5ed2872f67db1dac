"""The three questions put to the conic kernel: is it feasible, what is the least, how much more."""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array
from wbc.compiled import kernel
from wbc.forces.arrow import back_substitute, cholesky, dot, largest, transposed
from wbc.forces.cones import cone_margins
from wbc.forces.conic import NEGATIVE, OPTIMAL, POSITIVE, STALLED, conic
from wbc.forces.interior import Question
from wbc.forces.newton import Constraints

UNRANKED = 4
"""rank G < 6."""
POINT, FRICTION, LEAST, LOAD = range(4)
"""What may be wanted, see `settle`."""

_RANK = 1e-13
_MOST, _EASY = 50, 14


@kernel
def first_point(given: Constraints, rest: float, u: Array) -> float:
    """Fill u with equal normal forces that leave half of every torque range, if any do.

    They are as large as the wrench asks for or, without one, the force at rest.

    Returns:
        The force, [N]; 0 where τ_e alone breaks a limit.
    """
    contact, tau = given.shape.contact, np.empty(len(given.tau_e))
    n = len(contact) - 1
    for k in range(len(u)):
        u[k] = 0.0
    for i in range(n):
        u[contact[i] + 2] = 1.0
    transposed(given.shape, given.jacobian, u, tau)
    force, inside = max(rest, 2.0 * np.sqrt(dot(given.h, given.h)) / n), True
    for j in range(len(tau)):
        up = given.limit[1, j] - given.tau_e[j]
        down = given.tau_e[j] - given.limit[0, j]
        room = up if tau[j] > 0.0 else down
        inside &= up > 0.0 and down > 0.0
        if tau[j] != 0.0 and room > 0.0:
            force = min(force, 0.5 * room / abs(tau[j]))
    for i in range(n):
        u[contact[i] + 2] = force
    return float(force) if inside else 0.0


@kernel
def least_squares(gt: Array, h: Array, u: Array) -> bool:
    """Fill u with G⁺ h; False where rank G < 6."""
    s, x = np.zeros((6, 6)), h.copy()
    for i in range(len(u)):
        for k in range(6):
            for j in range(k + 1):
                s[k, j] += gt[i, k] * gt[i, j]
    if not cholesky(s, 0, 6, _RANK, 0.0):
        return False
    back_substitute(s, x)
    for i in range(len(u)):
        u[i] = dot(x, gt[i])
    return True


@kernel
def margin_question(given: Constraints, force: float, u: Array) -> tuple[Question, float]:
    """Phase I: the largest t with every cone margin ≥ t F, every torque margin ≥ t half its range.

    F is the force of `first_point`. From u; p = −t.
    """
    contact, l_joints = given.shape.contact, len(given.tau_e)
    n, tau, a = len(contact) - 1, np.empty(l_joints), np.full((2, l_joints), -1.0)
    force = max(force, 1e-3 * largest(given.h))
    transposed(given.shape, given.jacobian, u, tau)
    p = max(0.0, -cone_margins(contact, u, np.empty(n)) / force)
    for j in range(l_joints):
        low, high = given.limit[0, j], given.limit[1, j]
        if np.isfinite(low):
            half = 0.5 * (high - low)
            a[0, j] = a[1, j] = half
            t = tau[j] + given.tau_e[j]
            p = max(p, max(low - t, t - high) / half)
    f, e, g = np.zeros(len(u)), np.full(n, force), np.zeros(6)
    return Question(f, e, a, g, -1.0, True, True), p + 1.0


@kernel
def least_question(given: Constraints) -> Question:
    """min Σ c_z."""
    contact, l_joints = given.shape.contact, len(given.tau_e)
    n, a, f = len(contact) - 1, np.full((2, l_joints), -1.0), np.zeros(len(given.gt))
    for i in range(n):
        f[contact[i] + 2] = 1.0
    for j in range(l_joints):
        if np.isfinite(given.limit[0, j]):
            a[0, j] = a[1, j] = 0.0
    return Question(f, np.zeros(n), a, np.zeros(6), 0.0, False, False)


@kernel
def load_question(given: Constraints, u: Array) -> tuple[Question, float]:
    """The largest load factor λ, from u inside the cones: p = 1/λ.

    In u/λ the torque limits open with 1/λ, and nothing else changes. The start p is NaN where τ_e
    alone breaks a limit, and 0 where no limit binds.
    """
    l_joints = len(given.tau_e)
    tau, a, p = np.empty(l_joints), np.full((2, l_joints), -1.0), 0.0
    transposed(given.shape, given.jacobian, u, tau)
    for j in range(l_joints):
        if np.isfinite(given.limit[0, j]):
            a[0, j] = given.tau_e[j] - given.limit[0, j]
            a[1, j] = given.limit[1, j] - given.tau_e[j]
            if not (a[0, j] > 0.0 and a[1, j] > 0.0):
                p = np.nan
            p = max(p, max(-tau[j] / a[0, j], tau[j] / a[1, j])) if p == p else p
    ask = Question(
        np.zeros(len(u)), np.zeros(len(given.shape.contact) - 1), a, np.zeros(6), 0.0, True, False
    )
    return ask, 2.0 * p


@kernel
def settle(
    given: Constraints, want: int, rest: float, tolerance: float, u: Array
) -> tuple[int, int, float]:
    """Answer what is wanted by the conic method; u is filled.

    Args:
        want: POINT, strictly inside all constraints on G u = h; FRICTION, the same without torque
            limits; LEAST, the exact optimum min Σ c_z; LOAD, the largest load factor.
        rest: the force to start with where nothing asks for one, [N].

    Returns:
        NEGATIVE (POINT, FRICTION: u is such a point, with at least half the largest margin),
        OPTIMAL (LEAST, LOAD), POSITIVE (proven infeasible; LOAD: by friction), UNRANKED or
        STALLED (no verdict); iterations; the margin t, a certified lower bound of Σ c_z, or the
        load factor.
    """
    l_joints, least = len(given.tau_e), np.empty(len(u))
    if not least_squares(given.gt, given.h, least):
        return UNRANKED, 0, 0.0
    now, most = given, int(_MOST)
    if want in (FRICTION, LOAD):
        none = np.full((2, l_joints), np.inf)
        none[0] = -np.inf
        now = Constraints(given.shape, given.jacobian, given.gt, np.zeros(l_joints), none, given.h)
    used, force = 0, first_point(now, rest, u)
    if want == LEAST and force > 0.0:  # phase I only where it is hard
        code, used, p, bound = conic(now, least_question(now), tolerance, int(_EASY), u, 0.0)
        if code == OPTIMAL:
            return code, used, bound
    u[:] = least
    ask, p = margin_question(now, force, u)
    code, more, p, _ = conic(now, ask, tolerance, most, u, p)
    used += more
    if code == OPTIMAL:  # of the margin; its sign is what was asked
        code = NEGATIVE if p < 0.0 else POSITIVE if p > 1e-5 * tolerance else STALLED
    if code != NEGATIVE and want == LOAD:  # without room for friction there is none for a load
        return POSITIVE if code == STALLED and p > -1e-6 else code, used, 0.0
    if code != NEGATIVE or want in (POINT, FRICTION):
        return code, used, -p
    if want == LEAST:
        ask, p = least_question(given), 0.0
    else:
        ask, p = load_question(given, u)
        if not p > 0.0:
            return OPTIMAL, used, np.inf if p == 0.0 else np.nan
        now = Constraints(
            given.shape, given.jacobian, given.gt, now.tau_e, np.zeros((2, l_joints)), given.h
        )
    code, more, p, bound = conic(now, ask, tolerance, most, u, p)
    used += more
    if want == LOAD:
        bound = 1.0 / p if p > 1e-9 else np.inf
    return code, used, bound
