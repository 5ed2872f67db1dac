"""The first point of a tick out of the forces of the tick before: equation (21)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.arrays import Array
from wbc.compiled import kernel
from wbc.forces.flow_kernels import (
    DONE,
    RANK,
    STALE,
    STUCK,
    Fixed,
    Rows,
    Tracked,
    assemble,
    fixed,
    flow,
    full_rank,
    lifting,
    phi,
    tick,
)
from wbc.forces.problem import GraspForceProblem

_TRIES = 20
_REACH = 0.5  # of the way to the boundary, which the barrier must lead away from again
_BETWEEN = 10  # steps of the flow from one γ to the next; with one, as printed, jumps are lost
_SETTLED = 1e-2  # relative decrease of Φ below which fewer do
_SLOWEST = 1e-7  # rise of γ in a step of the cycle below which it is given up


class InitialPoint(NamedTuple):
    """A point of (21).

    Attributes:
        c: (M,) contact forces; G c is the fraction gamma of the way from G_k c_{k−1} to h_e.
        gamma: 1: c balances h_e and is inside; 0: not even a first step is inside.
    """

    c: Array
    gamma: float


def initial_point(
    previous: GraspForceProblem, previous_c: Array, problem: GraspForceProblem,
    *, weight: Array | None = None,
) -> InitialPoint:  # fmt: skip
    """c̄_0 and γ_0 of (21): as far towards the new wrench as the cones and limits allow.

    c̄ = (I − G^# G) c_{k−1} + G^# (γ h_e + (1 − γ) G c_{k−1}), all G of the new tick. As printed
    the last term is G_{k−1}† h_{k−1} and the first has the plain inverse: where G changes, or G^#
    is weighted, that does not return c_{k−1} at γ = 0, and there may be no valid γ. The torques are
    judged with Jᵀ and τ_e at γ between those of both ticks, J in place of J(q).

    Args:
        previous: the tick before, its forces `previous_c` (M,) in the units of the problem.
        problem: the new tick.
        weight: (M,) diagonal of W_G (22) for G^# (23), in (x/μ, y/μ, z, t/μ_t); None: all the same.
    """
    fix = fixed(problem)
    before, now = assemble(fix, tick(previous)), assemble(fix, tick(problem))
    u = previous_c / fix.scale
    inverse = np.ones(problem.size) if weight is None else 1.0 / weight
    lift = lifting(now.g, inverse)
    gamma, u = approach(fix, before, now, lift, now.g @ u, u, 0.0)
    return InitialPoint(fix.scale * u, gamma)


@kernel
def between(before: Rows, now: Rows, gamma: float) -> Rows:
    """The bounds at γ between two ticks, with the balance of the new one."""
    b = gamma * now.b + (1.0 - gamma) * before.b
    return Rows(now.g, now.h, b, gamma * now.free + (1.0 - gamma) * before.free)


@kernel
def approach(
    fix: Fixed, before: Rows, now: Rows, lift: Array, wrench: Array, u: Array, gamma: float
) -> tuple[float, Array]:
    """The largest γ of (21), at least the one reached, and its point.

    Args:
        lift: (M, 6) G^#.
        wrench: (6,) G_k c_{k−1}, where γ = 0.
        u: (M,) the point reached.
        gamma: the γ reached.
    """
    present = now.g @ u
    low, high, best = gamma, 1.0, u
    trial = 1.0
    for _ in range(_TRIES):
        there = u + lift @ (trial * now.h + (1.0 - trial) * wrench - present)
        rows = between(before, now, trial)
        slack = rows.b @ there + rows.free
        if np.isfinite(phi(fix, fix.barrier, there, slack)):
            if trial == 1.0:
                return 1.0, there
            low, best = trial, there
            break
        high = trial
        trial = low + 0.5 * (high - low)
    if low == gamma:
        return gamma, best
    for _ in range(4):  # the boundary is between low and high: closer to it
        trial = low + 0.5 * (high - low)
        there = u + lift @ (trial * now.h + (1.0 - trial) * wrench - present)
        rows = between(before, now, trial)
        if np.isfinite(phi(fix, fix.barrier, there, rows.b @ there + rows.free)):
            low = trial
        else:
            high = trial
    trial = gamma + _REACH * (low - gamma)
    best = u + lift @ (trial * now.h + (1.0 - trial) * wrench - present)
    rows = between(before, now, trial)
    if np.isfinite(phi(fix, fix.barrier, best, rows.b @ best + rows.free)):
        return trial, best
    return gamma, u


@kernel
def arrived(
    fix: Fixed, before: Rows, now: Rows, c: Array, inverse: Array,
    method: int, printed: bool, most: int,
) -> Tracked:  # fmt: skip
    """The point of (21) with γ = 1; where γ_j < 1, the flow leads away from what stopped it.

    Args:
        c: (M,) forces of the tick before.
        inverse: (M,) diagonal of W_G⁻¹ (22).
    """
    u = c / fix.scale
    if not np.isfinite(phi(fix, fix.barrier, u, before.b @ u + before.free)):
        return Tracked(u, 0.0, 0, STALE)
    if not full_rank(now.g):
        return Tracked(u, 0.0, 0, RANK)
    lift, wrench = lifting(now.g, inverse), now.g @ u
    gamma, u = approach(fix, before, now, lift, wrench, u, 0.0)
    steps, short = 0, int(_BETWEEN)  # a variable: a constant would compile the flow anew
    while gamma < 1.0:
        if steps >= most:
            return Tracked(u, gamma, steps, STUCK)
        rows = between(before, now, gamma)
        u, _, taken = flow(fix, rows, fix.barrier, u, method, printed, _SETTLED, short)
        steps += max(taken, 1)
        last = gamma
        gamma, u = approach(fix, before, now, lift, wrench, u, gamma)
        if gamma - last < _SLOWEST and taken == 0:
            return Tracked(u, gamma, steps, STUCK)
    return Tracked(u, gamma, steps, DONE)
