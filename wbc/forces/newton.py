"""Newton's method on the chapter's cost (15): structured, from a start that need not balance.

Everything here is inside: components divided by `scale`, so that a cone is z ≥ |s|, in the order of
`Blocks`. An iteration solves for the step d and the multipliers ν of

    H d + Gᵀ ν = −∇Φ,   G d = −(G u − h),

one block a contact or finger (`wbc.forces.arrow`). d is Newton's step for the convex function
Φ(u) + νᵀ(G u − h) with that ν, which therefore falls along d: the line search is on it. A full step
balances; from then on it is Newton's method on Φ in the null space of G.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.arrays import Array
from wbc.compiled import kernel
from wbc.forces.arrow import (
    Shape,
    add,
    add_joints,
    add_product,
    dot,
    factor,
    room_for,
    solve,
    transposed,
    unbalanced,
)
from wbc.forces.blocks import HandJacobian
from wbc.forces.cones import cone_step

CONVERGED, STALLED, SINGULAR, OUTSIDE = 0, 1, 2, 3

_NEAR = 0.95  # of the way to the boundary, at most
_ARMIJO = 1e-4
_LEAST = 1e-7  # a step this short is no progress
_RANK = 1e-13  # a pivot of S, relative, below which the contacts cannot answer some wrench


class Constraints(NamedTuple):
    """What u must satisfy, inside.

    Attributes:
        shape: order of contacts and joints.
        jacobian: J, its components multiplied by the scale.
        gt: (M, 6) Gᵀ.
        tau_e: (l',) [Nm].
        limit: (2, l') lower and upper limits of τ, [Nm]; infinite: none.
        h: (6,) wrench to supply.
    """

    shape: Shape
    jacobian: HandJacobian
    gt: Array
    tau_e: Array
    limit: Array
    h: Array


class Barrier(NamedTuple):
    """Weights of the cost (15), inside.

    Attributes:
        press: 2 w_p.
        friction: (n,) 2 w_bF μ_i.
        weight: (2, l') w_bT (τ_max − τ_min) of the lower and the upper limits; 0 drops one.
    """

    press: float
    friction: Array
    weight: Array


@kernel
def contact_terms(
    shape: Shape, barrier: Barrier, u: Array, hessian: Array, gradient: Array
) -> float:
    """Normal forces and friction barrier: 2 w_p z + 2 w_bF μ z / (z² − |s|²), over all contacts.

    Args:
        u: (M,) components inside.
        hessian: as in `Matrix`, overwritten; gradient: (M,) overwritten.

    Returns:
        The value; inf on or outside a cone's boundary.
    """
    contact, block, _ = shape
    press, friction, _ = barrier
    value = 0.0
    for b in range(len(block) - 1):
        low, high = contact[block[b]], contact[block[b + 1]]
        for r in range(low, high):
            for k in range(high - low):
                hessian[r, k] = 0.0
        for i in range(block[b], block[b + 1]):
            first, last = contact[i], contact[i + 1]
            n = first + 2
            z = u[n]
            square = 0.0
            for k in range(first, last):
                if k != n:
                    square += u[k] * u[k]
            s = np.sqrt(square)
            w = (z - s) * (z + s)
            if not (w > 0.0 and z > 0.0):
                return np.inf
            one = 1.0 / w
            weight = friction[i] * one
            value += press * z + weight * z
            weight *= one  # barrier / w²
            gradient[n] = press - weight * (z * z + square)
            cubic = weight * one  # barrier / w³
            hessian[n, n - low] = 2.0 * cubic * z * (z * z + 3.0 * square)
            across = -2.0 * cubic * (3.0 * z * z + square)
            for k in range(first, last):
                if k == n:
                    continue
                gradient[k] = 2.0 * weight * z * u[k]
                hessian[max(k, n), min(k, n) - low] = across * u[k]
                for j in range(first, k + 1):
                    if j != n:
                        hessian[k, j - low] = 8.0 * cubic * z * u[k] * u[j]
                hessian[k, k - low] += 2.0 * weight * z
    return value


@kernel
def joint_terms(tau: Array, limit: Array, weight: Array, slope: Array, curvature: Array) -> float:
    """Torque barrier Σ weight / (distance to a limit), its slope and curvature by τ (l',).

    Args:
        limit, weight: (2, l') lower and upper limits; one of weight 0 is none.

    Returns:
        The value; inf on or outside a limit.
    """
    value = 0.0
    for j in range(len(tau)):
        slope[j] = curvature[j] = 0.0
    for side in range(2):
        sign = 1.0 - 2.0 * side
        for j in range(len(tau)):
            if weight[side, j] > 0.0:
                distance = sign * (tau[j] - limit[side, j])
                if not distance > 0.0:
                    return np.inf
                one = 1.0 / distance
                term = weight[side, j] * one
                value += term
                slope[j] -= sign * term * one
                curvature[j] += 2.0 * term * one * one
    return value


@kernel
def _value(
    given: Constraints, barrier: Barrier, u: Array, d: Array, step: float, tau: Array, dtau: Array
) -> float:
    """Φ at u + step d; inf outside its domain."""
    contact, weight, value = given.shape.contact, barrier.weight, 0.0
    for i in range(len(contact) - 1):
        first = contact[i]
        z = u[first + 2] + step * d[first + 2]
        square = 0.0
        for k in range(first, contact[i + 1]):
            if k != first + 2:
                x = u[k] + step * d[k]
                square += x * x
        w = (z - np.sqrt(square)) * (z + np.sqrt(square))
        if not (w > 0.0 and z > 0.0):
            return np.inf
        value += barrier.press * z + barrier.friction[i] * z / w
    for side in range(2):
        sign = 1.0 - 2.0 * side
        for j in range(len(tau)):
            if weight[side, j] > 0.0:
                distance = sign * (tau[j] + step * dtau[j] - given.limit[side, j])
                if not distance > 0.0:
                    return np.inf
                value += weight[side, j] / distance
    return value


@kernel
def value_at(given: Constraints, barrier: Barrier, u: Array, tau: Array) -> float:
    """Φ (15) at u with torques tau; inf outside its domain."""
    return _value(given, barrier, u, u, 0.0, tau, tau)


@kernel
def longest_step(
    given: Constraints, barrier: Barrier, u: Array, d: Array, tau: Array, dtau: Array
) -> float:
    """Largest step to the boundary of any cone or torque limit of positive weight."""
    limit, step = given.limit, cone_step(given.shape.contact, u, d)
    for side in range(2):
        sign = 1.0 - 2.0 * side
        for j in range(len(tau)):
            if barrier.weight[side, j] > 0.0 and sign * dtau[j] < 0.0:
                step = min(step, (limit[side, j] - tau[j]) / dtau[j])
    return step


@kernel
def _next_error(
    given: Constraints, barrier: Barrier, u: Array, d: Array, tau: Array, dtau: Array
) -> float:
    """What Φ will be above its optimum after the full step d, estimated.

    A Newton step leaves ½ tᵀH⁻¹t with t half the third derivative along d twice. One term w/x, with
    x to second order x + dx − dy²/2r (a cone's wall is bent across s), gives, with a = dx/x and
    e = dy²/rx, no more than w/x (¼ (3 a² + e)² + 2 a² e); a torque limit's wall is flat, e = 0.
    """
    contact, weight, total = given.shape.contact, barrier.weight, 0.0
    for i in range(len(contact) - 1):
        first = contact[i]
        z, dz = u[first + 2], d[first + 2]
        square, along, moved = 0.0, 0.0, 0.0
        for k in range(first, contact[i + 1]):
            if k != first + 2:
                square += u[k] * u[k]
                along += u[k] * d[k]
                moved += d[k] * d[k]
        s = np.sqrt(square)
        ds = along / s if s > 0.0 else 0.0
        bend = max(moved - ds * ds, 0.0) / max(s, z / 3.0)
        for sign in range(-1, 2, 2):
            x = z + sign * s
            a, e = (dz + sign * ds) / x, bend / x
            a *= a
            total += 0.5 * barrier.friction[i] / x * (0.25 * (3.0 * a + e) ** 2 + 2.0 * a * e)
    for side in range(2):
        for j in range(len(tau)):
            if weight[side, j] > 0.0:
                distance = abs(tau[j] - given.limit[side, j])
                a = dtau[j] / distance
                total += 2.25 * weight[side, j] / distance * a * a * a * a
    return total


@kernel
def newton(
    given: Constraints, barrier: Barrier, tolerance: float, most: int, u: Array, tau: Array
) -> tuple[int, int]:
    """Minimise Φ on G u = h from u, which must be inside every cone and limit; u is replaced.

    Args:
        tolerance: of Φ, relative; most: iterations.
        u: (M,) start, replaced by the solution; tau: (l',) filled with its torques.

    Returns:
        CONVERGED, STALLED (no optimum in `most` iterations: far away, or infeasible), SINGULAR
        (the blocks or S are not positive to rounding) or OUTSIDE (bad start); iterations.
    """
    shape, jacobian = given.shape, given.jacobian
    m, l_joints = len(u), len(tau)
    matrix = room_for(shape, jacobian.shared.shape[0])
    matrix.across[:, :6] = given.gt
    few = matrix.s.shape[0]
    a, b = 2 * m, 2 * m + 3 * l_joints
    room = np.empty(b + 6 + few)  # one piece of memory: seven take as long as a finger
    gradient, d, residual, nu = room[:m], room[m:a], room[b : b + 6], room[b + 6 :]
    slope, curvature = room[a : a + l_joints], room[a + l_joints : b - l_joints]
    dtau = room[b - l_joints : b]
    transposed(shape, jacobian, u, tau)
    add(1.0, given.tau_e, tau)
    for iteration in range(most):
        value = contact_terms(shape, barrier, u, matrix.hessian, gradient)
        value += joint_terms(tau, given.limit, barrier.weight, slope, curvature)
        if not value < np.inf:
            return OUTSIDE, iteration
        add_product(shape, jacobian, slope, gradient)
        add_joints(shape, jacobian, curvature, matrix)
        unbalanced(given.gt, u, given.h, residual)
        if not factor(shape, matrix, _RANK, 0.0):
            return SINGULAR, iteration
        solve(shape, matrix, gradient, residual, d, nu)  # d and ν with the opposite sign
        for i in range(m):
            d[i] = -d[i]
        along, lift = dot(gradient, d), dot(residual, nu)
        transposed(shape, jacobian, d, dtau)
        step = min(1.0, _NEAR * longest_step(given, barrier, u, d, tau, dtau))
        last = step == 1.0 and (_next_error(given, barrier, u, d, tau, dtau) <= tolerance * value)
        while not last:
            new = _value(given, barrier, u, d, step, tau, dtau)
            # of Φ + νᵀ(G u − h)
            if new + step * lift <= value + _ARMIJO * step * (along + lift) + 1e-14 * value:
                break
            step *= 0.5
            if step < _LEAST:
                return STALLED, iteration + 1
        add(step, d, u)
        transposed(shape, jacobian, u, tau)
        add(1.0, given.tau_e, tau)
        if last:
            return CONVERGED, iteration + 1
    return STALLED, most
