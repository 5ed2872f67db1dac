"""Each hand on its own: the sub-optimal single-hand optimization of 1.4, with (22) and (23)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel
from wbc.errors import WbcError
from wbc.forces.flow_kernels import (
    DONE,
    MOST_STEPS,
    RANK,
    Fixed,
    Rows,
    Tick,
    Tracked,
    assemble,
    fixed,
    flow,
    full_rank,
    tick,
)
from wbc.forces.flows import METHODS, MOST, TOLERANCE, finished
from wbc.forces.initial_point import arrived
from wbc.forces.problem import GraspForceProblem
from wbc.forces.solution import GraspForceSolution

_LEAST = 1e-3  # of the largest δ: a smaller one would leave its hand no load at all


class Split(NamedTuple):
    """A solution composed of the hands' own.

    Attributes:
        solution: in balance and inside all limits, but not the common optimum. Its iterations are
            those of all hands together.
        share: (H,) δ_h / Σ δ, the load-sharing coefficients of Figure 10.
    """

    solution: GraspForceSolution
    share: Array


def split(
    previous: GraspForceProblem, previous_c: Array, problem: GraspForceProblem, hands: IntArray,
    method: str = "flow18", *, weighted: bool = True,
    tolerance: float = TOLERANCE, most: int = MOST,
) -> Split:  # fmt: skip
    """One tick: the common first point (21), then every hand by itself with the load it got there.

    The torques of a joint that moves several hands may change by an equal part of its room in each
    of them. Each hand must be able to answer any wrench by itself (rank 6), or the status is
    RANK_DEFICIENT; the others are those of `wbc.forces.flows.track`.

    Args:
        hands: (n,) the hand of each contact, 0 to H − 1.
        weighted: (21) with the inverse weighted by (22), so that a change of the load goes to the
            hands with more room to their torque limits.

    Raises:
        WbcError: `hands` does not fit.
    """
    fix = fixed(problem)
    c = np.ascontiguousarray(previous_c, dtype=np.float64)
    found, share = tracked_split(
        fix, tick(previous), tick(problem), by_component(problem, hands), c,
        METHODS[method], weighted, tolerance, most,
    )  # fmt: skip
    return Split(finished(problem, found), share)


def by_component(problem: GraspForceProblem, hands: IntArray) -> IntArray:
    """(M,) the hand of each component of c.

    Raises:
        WbcError: not one hand for each contact, or a number left out.
    """
    hands = np.asarray(hands)
    if hands.shape != (problem.contacts,) or hands.dtype.kind not in "iu":
        raise WbcError(f"hands has shape {hands.shape}, expected ({problem.contacts},) of integers")
    if set(hands.tolist()) != set(range(int(hands.max()) + 1)):
        raise WbcError("hands must number the hands from 0, none left out")
    return np.repeat(hands.astype(np.int64), problem.dims)


@kernel
def rooms(b: Array, slack: Array, hand: IntArray) -> Array:
    """(H,) δ of each hand: the least distance to a limit of the joints that move it, [Nm].

    A hand without limits counts as the one with the most room; where none has any, all are 1.
    Never less than a thousandth of the largest, for (22) divides by δ.
    """
    count = hand.max() + 1
    delta = np.full(count, np.inf)
    for q in range(len(slack)):
        for i in range(len(hand)):
            if b[q, i] != 0.0 and slack[q] < delta[hand[i]]:
                delta[hand[i]] = slack[q]
    most = 0.0
    for d in delta:
        if np.isfinite(d):
            most = max(most, d)
    if most == 0.0:
        return np.ones(count)
    return np.minimum(np.maximum(delta, _LEAST * most), most)


@kernel
def tracked_split(
    fix: Fixed, before: Tick, now: Tick, hand: IntArray, c: Array,
    method: int, weighted: bool, tolerance: float, most: int,
) -> tuple[Tracked, Array]:  # fmt: skip
    """As `split`; hand (M,) of each component."""
    here, printed = assemble(fix, now), bool(0)  # the constant False would compile flow anew
    common, share = common_point(fix, before, now, hand, c, method, weighted, most)
    if common.code != DONE:
        return common, share
    u, steps, code = common.u.copy(), common.steps, DONE
    for h in range(len(share)):
        own, mine, part, barrier = _one_hand(fix, here, hand, h, common.u)
        if not full_rank(part.g):
            return Tracked(common.u, 1.0, steps, RANK), share
        found, done, taken = flow(
            mine, part, barrier, common.u[own], method, printed, tolerance, most
        )
        u[own] = found
        steps += taken
        if not done:
            code = MOST_STEPS
    return Tracked(u, 1.0, steps, code), share


@kernel
def common_point(
    fix: Fixed, before: Tick, now: Tick, hand: IntArray, c: Array,
    method: int, weighted: bool, most: int,
) -> tuple[Tracked, Array]:  # fmt: skip
    """The point of (21) that the hands begin from, and (H,) their shares."""
    then, here = assemble(fix, before), assemble(fix, now)
    u = c / fix.scale
    delta = rooms(then.b, then.b @ u + then.free, hand)
    share = delta / delta.sum()
    inverse = share[hand] if weighted else np.ones(len(hand))  # W_G⁻¹ (22), M_h of each hand
    return arrived(fix, then, here, c, inverse, method, bool(0), most), share


@kernel
def _one_hand(
    fix: Fixed, rows: Rows, hand: IntArray, h: int, u: Array
) -> tuple[IntArray, Fixed, Rows, Array]:
    """The components of hand h, and its own problem with the others' forces held."""
    own = np.flatnonzero(hand == h)
    slack = rows.b @ u + rows.free
    touched = np.zeros(len(slack))  # hands that each bound's joint moves
    mine = np.zeros(len(slack), dtype=np.bool_)
    for q in range(len(slack)):
        for other in range(hand.max() + 1):
            for i in range(len(hand)):
                if hand[i] == other and rows.b[q, i] != 0.0:
                    touched[q] += 1.0
                    mine[q] = mine[q] or other == h
                    break
    g, b = np.ascontiguousarray(rows.g[:, own]), np.ascontiguousarray(rows.b[mine][:, own])
    free = slack[mine] / touched[mine] - b @ u[own]
    contacts = np.flatnonzero(hand[fix.first[:-1]] == h)
    first = np.zeros(len(contacts) + 1, dtype=np.int64)
    first[1:] = np.cumsum((fix.first[1:] - fix.first[:-1])[contacts])
    part = Fixed(
        first, fix.scale[own], fix.cone[contacts], fix.press, fix.joint[mine], fix.sign[mine],
        fix.limit[mine], fix.barrier[mine], fix.arm,
    )  # fmt: skip
    return own, part, Rows(g, g @ u[own], b, free), fix.barrier[mine]
