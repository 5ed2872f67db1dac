"""Primal-dual path following for linear costs over the same constraints: structured, certified.

One kernel answers three questions, inside coordinates as in `wbc.forces.newton`:

    minimise fᵀu + p   on   G u + g p = h,
    u_i + e_i p ẑ in its cone,   ± (τ − limit) + a p ≥ 0,   p ≥ low:

least Σ c_z (f its normals, no p); the largest common margin −p of all constraints, whose sign is
the verdict on feasibility (phase I); and the largest load factor, 1/p. Nesterov-Todd scaling with
Mehrotra's predictor and corrector. An iteration factors one block a finger (`wbc.forces.arrow`), in
coordinates W⁻¹u, where the cones' part of the matrix is the identity: formed in u it would lose all
digits as the gap closes.

Because u itself is what must lie in the cones, any multipliers ν of the balance and z of the torque
bounds give cone multipliers Z = f + Gᵀν − J(z₀ − z₁) that are exactly stationary. Where Z lies in
the cones, duality bounds the optimum, and ν and z are the certificate.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel
from wbc.forces.arrow import (
    add,
    add_product,
    dot,
    largest,
    largest_term,
    solve,
    transposed,
    unbalanced,
)
from wbc.forces.cones import cone_margins, times
from wbc.forces.interior import (
    SIGN,
    Point,
    Question,
    Scaling,
    degree_of,
    direction,
    factored,
    first_multipliers,
    gap_after,
    lengths,
    new_point,
    new_scaling,
    opening,
    slacks,
)
from wbc.forces.newton import Constraints

OPTIMAL, POSITIVE, NEGATIVE, STALLED = 0, 1, 2, 3

_STEP, _MORE = 0.9, 0.09  # of the way to the boundary; more where the predictor goes far
# Multipliers that miss a cone by ε prove that no forces balance unless they are 1/ε times larger
# than what the multipliers gain; forces a million times the wrench are none.
_MOST_FORCE = 1e6
_TIMES = 10.0  # as large as the forces at hand may others be that a verdict is to cover
_POLISH = 3  # attempts at balance
_BALANCED, _BALANCED_P = 1e-9, 1e-6  # good enough after them, for forces and for a mere p


@kernel
def certificate(
    given: Constraints, f: Array, nu: Array, zb: Array, cones: Array
) -> tuple[float, float]:
    """The bound that multipliers prove on fᵀu without p, and the smallest margin of their Z.

    Args:
        nu: (6,) or longer, zb: (2, l'), 0 where there is no limit; cones: (M,) filled with Z.
    """
    value, contact = 0.0, given.shape.contact
    for k in range(6):
        value -= nu[k] * given.h[k]
    pull = np.empty(zb.shape[1])
    for j in range(len(pull)):
        pull[j] = zb[1, j] - zb[0, j]
        for k in range(2):
            if zb[k, j] > 0.0:
                value -= zb[k, j] * SIGN[k] * (given.tau_e[j] - given.limit[k, j])
    for i in range(len(f)):
        cones[i] = f[i]
        for k in range(6):
            cones[i] += given.gt[i, k] * nu[k]
    add_product(given.shape, given.jacobian, pull, cones)
    return value, cone_margins(contact, cones, np.empty(len(contact) - 1))


@kernel
def _rebalance(given: Constraints, ask: Question, at: Point, by: Scaling, ry: Array) -> None:
    """Move u to balance, by the shortest way in the present scaling."""
    shape, step = given.shape, new_point(len(at.u), at.sb.shape[1], len(by.nu_p))
    solve(shape, by.matrix, np.zeros(len(at.u)), -ry, step.u, step.nu)
    times(shape.contact, by.w, by.eta, step.u, False, step.u)
    transposed(shape, given.jacobian, step.u, step.sb[0])
    add(-1.0, step.sb[0], step.sb[1])
    add(1.0, step.u, step.s)
    add(min(1.0, _STEP * lengths(shape.contact, ask, at, step)[0]), step.u, at.u)


@kernel
def _missed(contact: IntArray, ask: Question, at: Point, dual: Array, least: float) -> float:
    """By how much the bound fails because multipliers miss cones or p's weight, for forces as u."""
    room = 1.0 + dot(ask.g, at.nu) - opening(contact, ask, dual, at.zb)
    forces = 0.0
    for i in range(len(contact) - 1):
        forces += abs(at.u[contact[i] + 2])
    return float(forces * max(-least, 0.0) + abs(at.p[0]) * max(-room, 0.0))


class Seen(NamedTuple):
    """Where an iteration stands.

    Attributes:
        value: fᵀu + p; gap: Σ slack × multiplier.
        missing: of what is proven of the optimum, or all but proven, to the value.
        left: the same, with what a verdict must cover.
        proven: what the multipliers prove of fᵀu without p; least: smallest margin of their Z.
        off: largest entry of G u + g p − h; size: what that is relative to.
        rp: residual of p's stationarity.
    """

    value: float
    gap: float
    missing: float
    left: float
    proven: float
    least: float
    off: float
    size: float
    rp: float


@kernel
def _seen(
    given: Constraints, ask: Question, at: Point, stationary: bool, best: float, none: Point,
    dual: Array, rx: Array, ry: Array,
) -> tuple[Seen, bool, float]:  # fmt: skip
    """Judge a point; fills dual with Z and the residuals rx (M,), ry (6,).

    Args:
        stationary: z has been Z exactly; best: the best bound proven so far, without p.
        none: any direction.

    Returns:
        What is seen, stationary and best from now on.
    """
    contact = given.shape.contact
    unbalanced(given.gt, at.u, given.h, ry)
    add(at.p[0], ask.g, ry)
    proven, least = certificate(given, ask.f, at.nu, at.zb, dual)
    off = 0.0
    for k in range(len(rx)):
        rx[k] = dual[k] - at.z[k]
        off = max(off, abs(rx[k]))
    if stationary or (least > 0.0 and off <= 1e-6 * largest(at.z)):
        stationary = True
        at.z[:] = dual
        rx[:] = 0.0
    gap, value = gap_after(at, none, 0.0, 0.0), dot(ask.f, at.u) + at.p[0]
    rp = 1.0 - at.p[2] + dot(ask.g, at.nu) - opening(contact, ask, at.z, at.zb)
    if ask.with_p:  # what is left between value and bound, and what the bound misses
        missed = _missed(contact, ask, at, dual, least)
        missing, left = gap + missed, gap + _TIMES * missed
    else:  # towards ν = 0 and z = 0, where Z = f is inside by 1
        best = max(best, proven / (1.0 - min(least, 0.0)))
        missing, left = value - best, np.inf
    size = largest_term(given.gt, at.u, given.h)
    seen = Seen(value, gap, missing, left, proven, least, largest(ry), size, rp)
    return seen, stationary, best


@kernel
def _advanced(
    given: Constraints, ask: Question, at: Point, by: Scaling, step: Point, seen: Seen,
    rx: Array, ry: Array, stationary: bool, degree: int,
) -> bool:  # fmt: skip
    """Predict, correct with the same factors, and go; False where that leads nowhere."""
    contact, rp, gap = given.shape.contact, seen.rp, seen.gap
    direction(given, ask, at, by, rx, ry, rp, 0.0, 0.0, 0.0, stationary, step)
    step_s, step_z = lengths(contact, ask, at, step)
    step_s, step_z = min(1.0, step_s), min(1.0, step_z)
    sigma = min(max((gap_after(at, step, step_s, step_z) / gap) ** 3, 1e-8), 1.0)
    weight = min(step_s, step_z)  # a short step tells little of the curvature
    direction(given, ask, at, by, rx, ry, rp, sigma, sigma * gap / degree, weight, stationary, step)
    step_s, step_z = lengths(contact, ask, at, step)
    way = _STEP + _MORE * weight
    step_s, step_z = min(1.0, way * step_s), min(1.0, way * step_z)
    if not (max(step_s, step_z) > 1e-9 and np.isfinite(dot(step.u, step.u))):
        return False
    add(step_s, step.u, at.u)
    if not ask.with_p and cone_margins(contact, at.u, np.empty(len(by.eta))) <= 0.0:
        add(-1e-3 * step_s, step.u, at.u)  # u = 0 to rounding
    at.p[0] += step_s * step.p[0]
    add(step_z, step.z, at.z)
    add(step_z, step.zb[0], at.zb[0])
    add(step_z, step.zb[1], at.zb[1])
    add(step_z, step.nu, at.nu)
    at.p[2] += step_z * step.p[2]
    return True


@kernel
def conic(
    given: Constraints, ask: Question, tolerance: float, most: int, u: Array, p: float
) -> tuple[int, int, float, float]:
    """Answer a question from u and p that satisfy every inequality strictly; u is replaced.

    Args:
        tolerance: of the gap, relative to the value; balance is a thousand times finer.
        most: iterations.

    Returns:
        OPTIMAL, POSITIVE or NEGATIVE (if only the sign is asked: p certainly above 0; p below 0
        and at least half as far as it can be) or STALLED; iterations; p; without p the best bound
        proven on the optimum.
    """
    m, l_joints, few = len(u), len(given.tau_e), 6 + given.jacobian.shared.shape[0]
    at, step = new_point(m, l_joints, few), new_point(m, l_joints, few)
    by, tau = new_scaling(given), np.empty(l_joints)
    dual, rx, ry = np.empty(m), np.empty(m), np.empty(6)
    add(1.0, u, at.u)
    at.p[0] = p if ask.with_p else 0.0
    # below which p counts as 0, or Σ c_z if it was a million times larger
    floor = 1e-6 if ask.with_p else 1e-6 * abs(dot(ask.f, u))
    degree, code, used, polished = degree_of(ask), STALLED, most, 0
    stationary, best, good_balance = False, -np.inf, _BALANCED_P if ask.with_p else _BALANCED
    seen = Seen(np.inf, np.inf, np.inf, np.inf, 0.0, 0.0, np.inf, 0.0, 0.0)
    for iteration in range(most):
        used = iteration
        slacks(given, ask, at, tau)
        if iteration == 0:
            first_multipliers(given.shape.contact, ask, at)
        seen, stationary, best = _seen(given, ask, at, stationary, best, step, dual, rx, ry)
        p, balanced = at.p[0], seen.off <= 1e-3 * tolerance * seen.size
        closed = seen.missing <= tolerance * max(abs(seen.value), floor)
        closed &= ask.with_p or seen.off <= 1e-4 * seen.size
        if closed and (balanced or polished == _POLISH):
            code = OPTIMAL if balanced or seen.off <= good_balance * seen.size else STALLED
            break
        if ask.sign_of_p and seen.proven > max(-seen.least, 0.0) * _MOST_FORCE * seen.size:
            code, best = POSITIVE, seen.proven
            break
        if ask.sign_of_p and balanced and p < 0.0 and (p <= 0.5 * ask.low or seen.gap <= -p):
            code = NEGATIVE
            break
        if not factored(given, ask, at, by):
            break
        if closed:  # all that is left is balance
            _rebalance(given, ask, at, by, ry)
            polished += 1
        elif not _advanced(given, ask, at, by, step, seen, rx, ry, stationary, degree):
            break
    if code == STALLED and seen.off <= good_balance * seen.size:  # to rounding, on most problems
        slack = 10.0 if ask.with_p else 2.0
        enough = slack * tolerance * max(abs(seen.value), floor)
        code = OPTIMAL if seen.missing <= enough else STALLED
    if code == STALLED and ask.sign_of_p and at.p[0] - seen.left > 0.0:  # all but proven
        code = POSITIVE
    u[:] = at.u
    return code, used, at.p[0], best
