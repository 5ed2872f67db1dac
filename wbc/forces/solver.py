"""The solver that users get: Newton's method, warm from tick to tick, and a verdict if it fails."""

from __future__ import annotations

from typing import NamedTuple, final

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray
from wbc.compiled import kernel
from wbc.forces.arrow import add, transposed
from wbc.forces.blocks import HandJacobian, find_blocks
from wbc.forces.conic import NEGATIVE, POSITIVE
from wbc.forces.inside import (
    REST,
    entries_of,
    margins,
    orders_of,
    pack,
    take,
    take_jacobian,
    unpacked,
)
from wbc.forces.newton import CONVERGED, Barrier, Constraints, newton, value_at
from wbc.forces.problem import GraspForceProblem
from wbc.forces.questions import UNRANKED, least_forces, most_load, phase_one
from wbc.forces.solution import ForceStatus

# what `_answer` and its callers return
_SOLVED, _INFEASIBLE, _UNRANKED, _NOT_FINITE, _BESIDE, _UNDECIDED = range(6)
# what `least_forces` says, in those terms: optimal, positive, negative, stalled, unranked
_CODES = (_SOLVED, _INFEASIBLE, _UNDECIDED, _UNDECIDED, _UNRANKED)
# what is asked
_PLAN, _EXACT, _FRICTION, _LOAD = range(4)

_WARM, _MOST = 25, 100
_TOLERANCE = 1e-7  # of Φ, and of the exact optimum, relative
_SCALARS = 5
_VERDICT = 1e-8  # of the margin that decides feasibility
_ROOM = 1e-3
_NO_START = np.empty(0)
_STATUS = {
    _UNRANKED: ForceStatus.RANK_DEFICIENT,
    _NOT_FINITE: ForceStatus.INVALID_INPUT,
    _UNDECIDED: ForceStatus.NOT_BALANCED,
}


class ForceStep(NamedTuple):
    """What one call gives, all evaluated; see `GraspForceSolution` for the fields."""

    status: ForceStatus
    c: Array
    tau: Array
    cone_margin: Array
    torque_margin: Array
    phi: float
    sum_normal: float
    iterations: int
    balance: float
    gap: float


@kernel
def _optimum(
    given: Constraints, barrier: Barrier, rest: float, warm: bool, u: Array, tau: Array
) -> tuple[int, int]:
    """The optimum of Φ: from u if warm; else, or if that fails, from a point of phase I."""
    used = 0
    if warm:
        code, used = newton(given, barrier, _TOLERANCE, _WARM, u, tau)
        if code == CONVERGED:
            return _SOLVED, used
    code, more, room = phase_one(given, rest, _VERDICT, u)
    used += more
    if code == UNRANKED:
        return _UNRANKED, used
    if code != NEGATIVE:
        return (_INFEASIBLE if code == POSITIVE or room < 0.0 else _UNDECIDED), used
    code, more = newton(given, barrier, _TOLERANCE, _MOST, u, tau)
    return (_SOLVED if code == CONVERGED else _UNDECIDED), used + more


@kernel
def _answer(
    layout: IntArray, fixed: Array, grasp: Array, own: Array, shared: Array, tau_e: Array,
    h_e: Array, start: Array, question: int, out: Array,
) -> tuple[int, int]:  # fmt: skip
    """Answer a question from start (empty: cold); own and shared are scaled in place.

    Args:
        out: filled with c (M,), margins of cones (n,), margins of torques and τ of the joints with
            limits (l,) each, Φ, Σ c_z, the balance error, the smallest margin as a share of c_z or
            of half a torque range, and a bound on Σ c_z (or the load factor).

    Returns:
        Code and iterations.
    """
    given, barrier, scale = unpacked(layout, fixed, own, shared)
    rows, _, joints = orders_of(layout)
    contact, tau_in = given.shape.contact, given.tau_e
    m, n, l_joints = len(rows), len(contact) - 1, len(tau_e)
    u, tau, rest, bound = np.zeros(m), np.zeros(len(joints)), fixed[REST], np.nan
    out[:] = 0.0
    if not take(layout, fixed, grasp, tau_e, h_e, given):
        return _NOT_FINITE, 0
    code, used = _SOLVED, 0
    if question == _LOAD:
        out[-1] = most_load(given, rest, _TOLERANCE, u)
        return code, used
    if question == _EXACT:
        code, used, bound = least_forces(given, rest, _TOLERANCE, u)
        code = _CODES[code]
    elif question == _FRICTION:
        for j in range(len(joints)):
            given.limit[0, j], given.limit[1, j] = -np.inf, np.inf
        code, used, _ = phase_one(given, rest, _VERDICT, u)
        return code, used
    else:
        for k in range(m if len(start) == m else 0):
            u[k] = start[rows[k]] / scale[k]
        code, used = _optimum(given, barrier, rest, len(start) == m, u, tau)
    for k in range(m):
        out[rows[k]] = u[k] * scale[k]
    transposed(given.shape, given.jacobian, u, tau)
    add(1.0, tau_in, tau)
    room = margins(layout, given, u, tau, out[m : m + n], out[m + n : m + n + l_joints])
    for j in range(len(joints)):
        out[m + n + l_joints + joints[j]] = tau[j]
    out[-5], out[-3], out[-2], out[-1] = (
        value_at(given, barrier, u, tau), _imbalance(given, u), room, bound
    )  # fmt: skip
    for i in range(n):
        out[-4] += u[contact[i] + 2]
    return code, used


@kernel
def _imbalance(given: Constraints, u: Array) -> float:
    """|G u − h| over the largest of |h| and |G_i u_i|, entries of components."""
    error, size = 0.0, 1e-300
    for k in range(6):
        rest = -given.h[k]
        size = max(size, abs(rest))
        for i in range(len(u)):
            term = given.gt[i, k] * u[i]
            rest += term
            size = max(size, abs(term))
        error = max(error, abs(rest))
    return error / size


@kernel
def answer_dense(
    layout: IntArray, fixed: Array, grasp: Array, jacobian: Array, tau_e: Array, h_e: Array,
    start: Array, question: int, out: Array,
) -> tuple[int, int]:  # fmt: skip
    """`_answer` with J as (M, l)."""
    own_at, shared_at, _ = entries_of(layout)
    m = jacobian.shape[0]
    own, shared = np.empty(len(own_at)), np.empty((len(shared_at) // m, m))
    if not take_jacobian(layout, jacobian, own, shared):
        return _BESIDE, 0
    code, used = _answer(layout, fixed, grasp, own, shared, tau_e, h_e, start, question, out)
    l_joints = len(tau_e)
    tau = out[len(out) - _SCALARS - l_joints : len(out) - _SCALARS]
    tau[:] = tau_e  # also of joints without limits
    for i in range(m):
        for j in range(l_joints):
            tau[j] += jacobian[i, j] * out[i]
    return code, used


@kernel
def answer_blocks(
    layout: IntArray, fixed: Array, grasp: Array, own: Array, shared: Array, tau_e: Array,
    h_e: Array, start: Array, question: int, out: Array,
) -> tuple[int, int]:  # fmt: skip
    """`_answer` with J in the form of `HandJacobian`."""
    return _answer(
        layout, fixed, grasp, own.copy(), shared.copy(), tau_e, h_e, start, question, out
    )


@final
class ForceSolver:
    """Solves problems that differ in G, J, τ_e, h_e only: contacts, limits, μ and weights stay.

    Holds no state of the ticks: where to start from is handed in.
    """

    def __init__(
        self, problem: GraspForceProblem, *, moves: BoolArray | None = None, margin: float = _ROOM
    ) -> None:
        """
        Args:
            problem: what stays; its J tells which joints move which fingers, unless `moves` does.
            moves: (l, n) whether joint j can ever move contact i.
            margin: share of a normal force that must be left of its cone, and of half a torque
                range to its limits, for a solution not to be of LOW_MARGIN.
        """
        self.problem, self.margin = problem, margin
        if moves is None:
            moves = np.logical_or.reduceat(problem.J != 0.0, problem.first, axis=0).T
        self._moves = moves
        self.blocks = find_blocks(problem, moves)
        self._inside = pack(problem, self.blocks)

    def solve(
        self, G: Array, J: Array | HandJacobian, tau_e: Array, h_e: Array,
        start: Array | None = None,
    ) -> ForceStep:  # fmt: skip
        """The optimum of the cost (15) by Newton's method; phase I decides where it fails.

        Args:
            G: (6, M), J: (M, l) or its blocks, tau_e: (l,), h_e: (6,) as in the problem.
            start: (M,) forces of the tick before; None: none.

        Returns:
            The forces with everything evaluated. Where the status is not usable they say how far
            the problem is from a solution and must not be applied. Never raises on numbers.
        """
        begin = _NO_START if start is None else start
        return self._asked(_PLAN, G, J, tau_e, h_e, begin)

    def exact(self, G: Array, J: Array | HandJacobian, tau_e: Array, h_e: Array) -> ForceStep:
        """The least Σ c_z on the same constraints, to a certified gap of 1e-7."""
        return self._asked(_EXACT, G, J, tau_e, h_e, _NO_START)

    def load_factor(self, G: Array, J: Array | HandJacobian, tau_e: Array, h_e: Array) -> float:
        """The largest λ with G c = λ h_e inside all limits.

        0 where friction cannot balance h_e at all; inf where no limit binds; NaN where τ_e alone
        is outside the torque limits.
        """
        out = self._new()
        self._call(_LOAD, G, J, tau_e, h_e, _NO_START, out)
        return float(out[-1])

    def _new(self) -> Array:
        p = self.problem
        return np.empty(p.size + p.contacts + 2 * p.joints + _SCALARS)

    def _call(
        self, question: int, G: Array, J: Array | HandJacobian, tau_e: Array, h_e: Array,
        start: Array, out: Array,
    ) -> tuple[int, int]:  # fmt: skip
        layout, fixed = self._inside
        if isinstance(J, HandJacobian):
            return answer_blocks(layout, fixed, G, *J, tau_e, h_e, start, question, out)
        code, used = answer_dense(layout, fixed, G, J, tau_e, h_e, start, question, out)
        if code == _BESIDE:  # a joint moves a finger that it had not moved: seen once
            if not np.isfinite(J).all():
                return _NOT_FINITE, 0
            self._moves = (
                self._moves | np.logical_or.reduceat(J != 0.0, self.problem.first, axis=0).T
            )
            self.blocks = find_blocks(self.problem, self._moves)
            self._inside = layout, fixed = pack(self.problem, self.blocks)
            return answer_dense(layout, fixed, G, J, tau_e, h_e, start, question, out)
        return code, used

    def _asked(
        self, question: int, G: Array, J: Array | HandJacobian, tau_e: Array, h_e: Array,
        start: Array,
    ) -> ForceStep:  # fmt: skip
        problem, out = self.problem, self._new()
        code, used = self._call(question, G, J, tau_e, h_e, start, out)
        a = problem.size
        b = a + problem.contacts
        c = b + problem.joints
        phi, total, balance, room, bound = out[-_SCALARS:].tolist()
        status, gap = ForceStatus.SOLVED, np.nan
        if code != _SOLVED:
            status = self._verdict(code, G, J, tau_e, h_e)
        elif question == _EXACT:
            gap = (total - bound) / total if total > 0.0 else 0.0
        elif room < self.margin:
            status = ForceStatus.LOW_MARGIN
        return ForceStep(
            status, out[:a], out[c:-_SCALARS], out[a:b], out[b:c], phi, total, used, balance, gap
        )

    def _verdict(
        self, code: int, G: Array, J: Array | HandJacobian, tau_e: Array, h_e: Array
    ) -> ForceStatus:
        if code == _INFEASIBLE:
            without, _ = self._call(_FRICTION, G, J, tau_e, h_e, _NO_START, self._new())
            strong = without == NEGATIVE
            return (
                ForceStatus.INFEASIBLE_TORQUE_LIMITS if strong else ForceStatus.INFEASIBLE_FRICTION
            )
        return _STATUS[code]
