"""One iteration of the conic method: scale, factor, predict, correct. See `wbc.forces.conic`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel
from wbc.forces.arrow import (
    Matrix,
    Shape,
    add,
    add_joints,
    add_product,
    dot,
    factor,
    room_for,
    solve,
    transposed,
)
from wbc.forces.blocks import HandJacobian
from wbc.forces.cones import complement, cone_step, scaling, times, times_rows
from wbc.forces.newton import Constraints

SIGN = (1.0, -1.0)
"""Of τ in the slack of a lower and of an upper limit."""


class Question(NamedTuple):
    """What is minimised, and how p opens the constraints.

    Attributes:
        f: (M,) cost of u.
        e: (n,) and a: (2, l') by how much p opens cones and limits; a < 0: no such limit.
        g: (6,) by how much p supplies the wrench.
        low: least p.
        with_p: p is an unknown; else it is 0.
        sign_of_p: only whether p can be below 0 is asked.
    """

    f: Array
    e: Array
    a: Array
    g: Array
    low: float
    with_p: bool
    sign_of_p: bool


class Point(NamedTuple):
    """Unknowns, slacks and multipliers; also a direction of all of them.

    Attributes:
        u: (M,), s: (M,) slacks of the cones, z: (M,) their multipliers.
        sb, zb: (2, l') slacks and multipliers of the torque limits.
        nu: (6 + n_a,) multipliers of the balance first.
        p: (3,) p, its slack p − low and its multiplier.
    """

    u: Array
    s: Array
    z: Array
    sb: Array
    zb: Array
    nu: Array
    p: Array


class Scaling(NamedTuple):
    """Nesterov-Todd scaling of all cones, and the factors of the step's matrix in W⁻¹u.

    Attributes:
        w: (M,), eta: (n,) as in `wbc.forces.cones`; lam: (M,) W z.
        jacobian: W J.
        matrix: factored.
        q: (M,) W × how p stands in stationarity; x_p: (M,), nu_p: (6 + n_a,) its solution.
        pivot: (1,) of p.
    """

    w: Array
    eta: Array
    lam: Array
    jacobian: HandJacobian
    matrix: Matrix
    q: Array
    x_p: Array
    nu_p: Array
    pivot: Array


@kernel
def new_point(m: int, l_joints: int, few: int) -> Point:
    return Point(
        np.zeros(m), np.zeros(m), np.zeros(m), np.zeros((2, l_joints)), np.zeros((2, l_joints)),
        np.zeros(few), np.zeros(3),
    )  # fmt: skip


@kernel
def new_scaling(given: Constraints) -> Scaling:
    m, (own, shared) = len(given.gt), given.jacobian
    few = 6 + shared.shape[0]
    return Scaling(
        np.empty(m), np.empty(len(given.shape.contact) - 1), np.empty(m),
        HandJacobian(np.empty(len(own)), np.empty((shared.shape[0], m))),
        room_for(given.shape, shared.shape[0]), np.zeros(m), np.zeros(m), np.zeros(few),
        np.zeros(1),
    )  # fmt: skip


@kernel
def degree_of(ask: Question) -> int:
    """How many cones and half-lines there are: Σ slack × multiplier over it is the centre."""
    return int(len(ask.e) + (ask.a >= 0.0).sum()) + int(ask.with_p)


@kernel
def slacks(given: Constraints, ask: Question, at: Point, tau: Array) -> None:
    """Slacks exactly as u and p give them."""
    shape, p = given.shape, at.p[0]
    transposed(shape, given.jacobian, at.u, tau)
    add(1.0, given.tau_e, tau)
    for k in range(len(at.u)):
        at.s[k] = at.u[k]
    for i in range(len(ask.e)):
        at.s[shape.contact[i] + 2] += ask.e[i] * p
    for k in range(2):
        for j in range(len(tau)):
            if ask.a[k, j] >= 0.0:
                at.sb[k, j] = SIGN[k] * (tau[j] - given.limit[k, j]) + ask.a[k, j] * p
    at.p[1] = p - ask.low if ask.with_p else 1.0


@kernel
def opening(contact: IntArray, ask: Question, z: Array, zb: Array) -> float:
    """How strongly p opens the constraints, weighed by multipliers: Σ e_i z_i + Σ a z."""
    total = 0.0
    for i in range(len(ask.e)):
        total += ask.e[i] * z[contact[i] + 2]
    for k in range(2):
        for j in range(ask.a.shape[1]):
            if ask.a[k, j] > 0.0:
                total += ask.a[k, j] * zb[k, j]
    return total


@kernel
def first_multipliers(contact: IntArray, ask: Question, at: Point) -> None:
    """On the central path's side of the slacks; without p such that Z = f."""
    n, centre = len(contact) - 1, 0.0
    if not ask.with_p:
        for i in range(n):
            head = contact[i] + 2
            centre += at.s[head] / n
        for k in range(len(at.z)):
            at.z[k] = ask.f[k]
    for k in range(2):
        for j in range(at.sb.shape[1]):
            if ask.a[k, j] >= 0.0:
                slack = at.sb[k, j] if ask.with_p else max(at.sb[0, j], at.sb[1, j])
                at.zb[k, j] = (1.0 if ask.with_p else centre) / slack
    if not ask.with_p:
        return
    for i in range(n):
        head, square = contact[i] + 2, 0.0
        for k in range(contact[i], contact[i + 1]):
            if k != head:
                square += at.s[k] * at.s[k]
        length = np.sqrt(square)
        square = (at.s[head] - length) * (at.s[head] + length)
        for k in range(contact[i], contact[i + 1]):
            at.z[k] = (at.s[k] if k == head else -at.s[k]) / square
    centre = 1.0 / (opening(contact, ask, at.z, at.zb) + 1.0 / at.p[1])  # p has weight 1
    for k in range(len(at.z)):
        at.z[k] *= centre
    for k in range(2):
        add(centre - 1.0, at.zb[k].copy(), at.zb[k])
    at.p[2] = centre / at.p[1]


@kernel
def _times_joints(shape: Shape, w: Array, eta: Array, own: Array, out: Array) -> None:
    """out = W J for the blocks' own joints."""
    contact, block, joint = shape
    value = 0
    for b in range(len(block) - 1):
        low, high = contact[block[b]], contact[block[b + 1]]
        for _ in range(joint[b], joint[b + 1]):
            shift = value - low
            for i in range(block[b], block[b + 1]):
                first, last = contact[i], contact[i + 1]
                head, along = first + 2, 0.0
                for k in range(first, last):
                    if k != head:
                        along += w[k] * own[k + shift]
                top = own[head + shift]
                out[head + shift] = eta[i] * (w[head] * top + along)
                along = top + along / (1.0 + w[head])
                for k in range(first, last):
                    if k != head:
                        out[k + shift] = eta[i] * (own[k + shift] + along * w[k])
            value += high - low


@kernel
def _scale_rows(given: Constraints, by: Scaling) -> None:
    """W Gᵀ into the first columns of Kᵀ, and W J."""
    contact = given.shape.contact
    own, shared = given.jacobian
    times_rows(contact, by.w, by.eta, given.gt, by.matrix.across)
    for a in range(shared.shape[0]):
        times(contact, by.w, by.eta, shared[a], False, by.jacobian.shared[a])
    _times_joints(given.shape, by.w, by.eta, own, by.jacobian.own)


@kernel
def _identity(shape: Shape, hessian: Array) -> None:
    contact, block, _ = shape
    for b in range(len(block) - 1):
        first, last = contact[block[b]], contact[block[b + 1]]
        for i in range(first, last):
            for k in range(last - first):
                hessian[i, k] = 1.0 if i - first == k else 0.0


@kernel
def factored(given: Constraints, ask: Question, at: Point, by: Scaling) -> bool:
    """Scale and factor at a point; with p also its column."""
    contact, l_joints = given.shape.contact, at.sb.shape[1]
    scaling(contact, at.s, at.z, by.w, by.eta)
    times(contact, by.w, by.eta, at.z, False, by.lam)
    _scale_rows(given, by)
    curvature, mixed, pivot = np.zeros(l_joints), np.zeros(l_joints), 0.0
    for k in range(2):
        for j in range(l_joints):
            a = ask.a[k, j]
            if a >= 0.0:
                weight = at.zb[k, j] / at.sb[k, j]
                curvature[j] += weight
                mixed[j] += SIGN[k] * a * weight
                pivot += a * a * weight
    _identity(given.shape, by.matrix.hessian)
    add_joints(given.shape, by.jacobian, curvature, by.matrix)
    if not factor(given.shape, by.matrix, 0.0, 1.0):
        return False
    if ask.with_p:
        for k in range(len(by.q)):
            by.q[k] = 0.0
        for i in range(len(by.eta)):
            by.q[contact[i] + 2] = ask.e[i]
        times(contact, by.w, by.eta, by.q, True, by.q)
        pivot += at.p[2] / at.p[1] + dot(by.q, by.q)
        add_product(given.shape, by.jacobian, mixed, by.q)
        solve(given.shape, by.matrix, by.q, ask.g, by.x_p, by.nu_p)
        by.pivot[0] = pivot - dot(by.q, by.x_p) - dot(ask.g, by.nu_p)
    return True


@kernel
def _push(
    contact: IntArray, ask: Question, at: Point, step: Point, by: Scaling, centre: float,
    weight: float, t: Array, tb: Array,
) -> float:  # fmt: skip
    """What complementarity asks of the multipliers: fills W t and tb, returns p's.

    λ ∘ (W t) = centre e − λ∘λ − weight (W⁻¹ds)∘(W dz), and so for the limits and p.
    """
    complement(contact, by.w, by.eta, by.lam, step.s, step.z, centre, weight, t)
    for k in range(2):
        for j in range(tb.shape[1]):
            if ask.a[k, j] >= 0.0:
                product = weight * step.sb[k, j] * step.zb[k, j]
                tb[k, j] = (centre - product) / at.sb[k, j] - at.zb[k, j]
    return float((centre - weight * step.p[1] * step.p[2]) / at.p[1] - at.p[2])


@kernel
def direction(
    given: Constraints, ask: Question, at: Point, by: Scaling, rx: Array, ry: Array, rp: float,
    sigma: float, centre: float, weight: float, stationary: bool, step: Point,
) -> None:  # fmt: skip
    """Replace step, the predictor for the corrector's second-order part, by the next direction."""
    shape, jacobian = given.shape, given.jacobian
    contact, keep, l_joints = shape.contact, 1.0 - sigma, at.sb.shape[1]
    t, tb, right = np.empty(len(at.u)), np.zeros((2, l_joints)), np.empty(len(at.u))
    t_p = _push(contact, ask, at, step, by, centre, weight, t, tb)
    times(contact, by.w, by.eta, rx, False, right)
    for k in range(len(right)):
        right[k] = t[k] - keep * right[k]
    difference, balance = np.empty(l_joints), np.empty(6)
    for j in range(l_joints):
        difference[j] = tb[0, j] - tb[1, j]
    add_product(shape, by.jacobian, difference, right)
    for k in range(6):
        balance[k] = -keep * ry[k]
    solve(shape, by.matrix, right, balance, step.u, step.nu)
    dp = 0.0
    if ask.with_p:
        times(contact, by.w, by.eta, t, True, right)  # W⁻¹ (W t)
        dp = t_p - keep * rp + opening(contact, ask, right, tb)
        dp = (dp - dot(by.q, step.u) - dot(ask.g, step.nu)) / by.pivot[0]
        add(-dp, by.x_p, step.u)
        add(-dp, by.nu_p, step.nu)
    step.p[0], step.p[1], step.p[2] = dp, dp, t_p - at.p[2] / at.p[1] * dp
    times(contact, by.w, by.eta, step.u, False, step.u)  # back to u
    for k in range(len(right)):
        step.s[k] = step.u[k]
    for i in range(len(by.eta)):
        step.s[contact[i] + 2] += ask.e[i] * dp
    times(contact, by.w, by.eta, step.s, True, step.z)
    for k in range(len(right)):
        step.z[k] = t[k] - step.z[k]
    times(contact, by.w, by.eta, step.z, True, step.z)
    transposed(shape, jacobian, step.u, difference)
    for k in range(2):
        for j in range(l_joints):
            if ask.a[k, j] >= 0.0:
                step.sb[k, j] = SIGN[k] * difference[j] + ask.a[k, j] * dp
                step.zb[k, j] = tb[k, j] - at.zb[k, j] / at.sb[k, j] * step.sb[k, j]
    if stationary:  # and to stay so to rounding, however badly scaled W is
        for j in range(l_joints):
            difference[j] = step.zb[1, j] - step.zb[0, j]
        for i in range(len(at.u)):
            step.z[i] = 0.0
            for k in range(6):
                step.z[i] += given.gt[i, k] * step.nu[k]
        add_product(shape, jacobian, difference, step.z)


@kernel
def lengths(contact: IntArray, ask: Question, at: Point, step: Point) -> tuple[float, float]:
    """Largest steps that keep slacks and multipliers inside."""
    step_s, step_z = cone_step(contact, at.s, step.s), cone_step(contact, at.z, step.z)
    for k in range(2):
        for j in range(at.sb.shape[1]):
            if ask.a[k, j] >= 0.0:
                if step.sb[k, j] < 0.0:
                    step_s = min(step_s, -at.sb[k, j] / step.sb[k, j])
                if step.zb[k, j] < 0.0:
                    step_z = min(step_z, -at.zb[k, j] / step.zb[k, j])
    if ask.with_p:
        if step.p[1] < 0.0:
            step_s = min(step_s, -at.p[1] / step.p[1])
        if step.p[2] < 0.0:
            step_z = min(step_z, -at.p[2] / step.p[2])
    return step_s, step_z


@kernel
def gap_after(at: Point, step: Point, step_s: float, step_z: float) -> float:
    """Σ slack × multiplier after a step."""
    total = (at.p[1] + step_s * step.p[1]) * (at.p[2] + step_z * step.p[2])
    for k in range(len(at.s)):
        total += (at.s[k] + step_s * step.s[k]) * (at.z[k] + step_z * step.z[k])
    for k in range(2):
        for j in range(at.sb.shape[1]):
            slack = at.sb[k, j] + step_s * step.sb[k, j]
            total += slack * (at.zb[k, j] + step_z * step.zb[k, j])
    return float(total)
