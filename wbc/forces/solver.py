"""The solver that users get: Newton's method, warm from tick to tick, and a verdict if it fails."""

from __future__ import annotations

from typing import NamedTuple, final

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray, read_only_view
from wbc.compiled import kernel
from wbc.errors import WbcError
from wbc.forces.arrow import add, transposed, unbalanced
from wbc.forces.blocks import HandJacobian, find_blocks, pattern
from wbc.forces.conic import NEGATIVE
from wbc.forces.inside import (
    REST,
    add_unlimited,
    imbalance,
    margins,
    orders_of,
    pack,
    take,
    take_jacobian,
    unpacked,
)
from wbc.forces.newton import CONVERGED, OUTSIDE, Barrier, Constraints, newton, value_at
from wbc.forces.problem import GraspForceProblem
from wbc.forces.questions import FRICTION, LEAST, LOAD, POINT, least_squares, settle
from wbc.forces.solution import ForceStatus

# what `_answer` and its callers return
_SOLVED, _INFEASIBLE, _UNRANKED, _NOT_FINITE, _BESIDE, _UNDECIDED = range(6)
# what `settle` says, in those terms: optimal, positive, negative, stalled, unranked
_CODES = (_SOLVED, _INFEASIBLE, _SOLVED, _UNDECIDED, _UNRANKED)
OPTIMUM = 10
"""Beside what `settle` may be asked."""

_WARM, _MOST = 25, 500  # so many only where barriers weigh next to nothing
_TOLERANCE = 1e-7  # of Φ, relative
_SCALARS = 5
_FINE = 1e-10  # of the balance
_GAP = 5e-7  # certified of the exact optimum, relative; twice as much where rounding ends it
_COARSE = 1e-6  # of the load factor, relative
_VERDICT = 1e-8  # of the margin that decides feasibility
_ROOM = 1e-3
_INSIDE, _BALANCED = 1e-13, 1e-9  # what forces must keep, of c_z or a range, to be SOLVED
_FLOOR = 1e-6  # of the force at rest: the least Σ c_z that a gap is relative to
_DOUBLE = np.dtype(np.float64)
_NO_START, _NO_J = np.empty(0), np.empty((0, 0))
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
    code, used, most, want = OUTSIDE, 0, int(_WARM), int(POINT)
    for attempt in range(2):
        if attempt == 1:
            code, more, _ = settle(given, want, rest, _VERDICT, u)
            used, most = used + more, int(_MOST)
            if code != NEGATIVE:
                return _CODES[code], used
        elif not warm:
            continue
        code, more = newton(given, barrier, _TOLERANCE, most, u, tau)
        used += more
        if code == CONVERGED:
            return _SOLVED, used
    return _UNDECIDED, used


@kernel
def answer(
    layout: IntArray, fixed: Array, grasp: Array, jacobian: Array, own: Array, shared: Array,
    tau_e: Array, h_e: Array, start: Array, question: int, out: Array,
) -> tuple[int, int]:  # fmt: skip
    """Answer a question from start (empty: cold), everything in the problem's order.

    Args:
        jacobian: (M, l), or (0, 0) where own and shared, as in `HandJacobian`, are given.
        question: OPTIMUM of Φ, or what `settle` may be asked.
        out: filled with c (M,), margins of cones (n,), margins of torques and τ (l,) each, Φ,
            Σ c_z, the balance error, the smallest margin as a share of c_z or of half a torque
            range, and the bound or factor that `settle` returns.

    Returns:
        Code and iterations.
    """
    out[:] = 0.0
    given, barrier, scale = unpacked(layout, fixed, own, shared)
    rows, _, joints = orders_of(layout)
    m, n, l_joints = len(rows), len(given.shape.contact) - 1, len(tau_e)
    if jacobian.size > 0 and not take_jacobian(layout, jacobian, given.jacobian):
        return _BESIDE, 0
    if not take(layout, fixed, grasp, tau_e, h_e, given):
        return _NOT_FINITE, 0
    u, tau, bound, rest = np.zeros(m), np.zeros(len(joints)), np.nan, fixed[REST]
    if question == OPTIMUM:
        warm = len(start) == m
        for k in range(m if warm else 0):
            u[k] = start[rows[k]] / scale[k]
            warm &= np.isfinite(u[k])
        code, used = _optimum(given, barrier, rest, warm, u, tau)
        if code == _SOLVED and imbalance(given, u) > _FINE:  # near limits, where S is ill
            rest_h, change = np.empty(6), np.empty(m)
            unbalanced(given.gt, u, given.h, rest_h)
            if least_squares(given.gt, rest_h, change):
                add(-1.0, change, u)
    else:
        tolerance = _COARSE if question == LOAD else _GAP
        found, used, bound = settle(given, question, rest, tolerance, u)
        code = _CODES[found]
    for k in range(m):
        out[rows[k]] = u[k] * scale[k]
    transposed(given.shape, given.jacobian, u, tau)
    add(1.0, given.tau_e, tau)
    a = m + n + l_joints
    room = margins(layout, given, u, tau, out[m : m + n], out[m + n : a])
    for j in range(l_joints):
        out[a + j] = tau_e[j]
    for j in range(len(joints)):
        out[a + joints[j]] = tau[j]
    if len(joints) < l_joints:
        add_unlimited(layout, jacobian, out[:m], out[a : a + l_joints])
    out[-5], out[-3] = value_at(given, barrier, u, tau), imbalance(given, u)
    out[-2], out[-1] = room, bound
    for i in range(n):
        out[-4] += u[given.shape.contact[i] + 2]
    for j in range(l_joints):  # of joints without limits nobody has asked yet
        if not np.isfinite(out[a + j]):
            return _NOT_FINITE, used
    if code == _SOLVED and question not in (FRICTION, LOAD):  # to rounding: no promise unchecked
        code = code if room > _INSIDE and out[-3] <= _BALANCED else _UNDECIDED
    return code, used


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

        Raises:
            WbcError: `moves` does not fit the problem.
        """
        self.problem, self.margin = problem, margin
        if moves is None:
            moves = np.logical_or.reduceat(problem.J != 0.0, problem.first, axis=0).T
        if np.shape(moves) != (problem.joints, problem.contacts):
            want = (problem.joints, problem.contacts)
            raise WbcError(f"moves has shape {np.shape(moves)}, expected {want}")
        m, l_joints = problem.size, problem.joints
        self._shapes = (6, m), (m, l_joints), (l_joints,), (6,)
        c = m + problem.contacts + l_joints
        self._ends = m, c - l_joints, c, c + l_joints, c + l_joints + _SCALARS
        self._arrange(np.asarray(moves, dtype=np.bool_))

    def solve(
        self, G: Array, J: Array | HandJacobian, tau_e: Array, h_e: Array,
        start: Array | None = None,
    ) -> ForceStep:  # fmt: skip
        """The optimum of the cost (15) by Newton's method; phase I decides where it fails.

        Args:
            G: (6, M), J: (M, l) or its blocks, tau_e: (l,), h_e: (6,) as in the problem.
            start: (M,) forces of the tick before; None, or of another size: none.

        Returns:
            The forces with everything evaluated. Where the status is not usable they say how far
            the problem is from a solution and must not be applied. Never raises on numbers.

        Raises:
            WbcError: arrays of another shape than the problem's, or not of numbers.
        """
        begin = _NO_START
        of_c = self._shapes[0][1:]
        if start is not None:
            shape = start.shape if type(start) is np.ndarray else np.shape(start)
            if shape == of_c:
                begin = _fitted("start", start, of_c)
                begin = begin if begin.flags.writeable else begin.copy()
        return self._asked(OPTIMUM, G, J, tau_e, h_e, begin)

    def inside(self, G: Array, J: Array | HandJacobian, tau_e: Array, h_e: Array) -> ForceStep:
        """A point of phase I: balanced, and well inside every cone and limit; not optimal."""
        return self._asked(POINT, G, J, tau_e, h_e, _NO_START)

    def exact(self, G: Array, J: Array | HandJacobian, tau_e: Array, h_e: Array) -> ForceStep:
        """The least Σ c_z on the same constraints, to a certified gap of at most 1e-6."""
        return self._asked(LEAST, G, J, tau_e, h_e, _NO_START)

    def load_factor(self, G: Array, J: Array | HandJacobian, tau_e: Array, h_e: Array) -> float:
        """The largest λ with G c = λ h_e inside all limits.

        0 where friction cannot balance h_e at all; inf where no limit binds; NaN where rank G < 6,
        τ_e alone is outside the torque limits, or the method found none.
        """
        out = self._new()
        code, _ = self._call(LOAD, G, J, tau_e, h_e, _NO_START, out)
        if not np.any(h_e) and code not in (_UNRANKED, _NOT_FINITE):
            low, high = self.problem.tau_min, self.problem.tau_max
            return np.inf if bool(np.all((low < tau_e) & (tau_e < high))) else np.nan
        return {_SOLVED: float(out[-1]), _INFEASIBLE: 0.0}.get(code, np.nan)

    def _new(self) -> Array:
        return np.empty(self._ends[-1])

    def _call(
        self, question: int, G: Array, J: Array | HandJacobian, tau_e: Array, h_e: Array,
        start: Array, out: Array,
    ) -> tuple[int, int]:  # fmt: skip
        layout, fixed = self._inside
        of_g, of_j, of_tau, of_h = self._shapes
        (own, shared), dense = self._room, _NO_J
        if isinstance(J, HandJacobian):
            own = _fitted("J.own", J.own, own.shape).copy()
            shared = _fitted("J.shared", J.shared, shared.shape).copy()
        else:
            dense = _fitted("J", J, of_j)
        # numba compiles anew for every mixture of arrays that may and may not be written to
        grasp, jacobian = read_only_view(_fitted("G", G, of_g)), read_only_view(dense)
        e = read_only_view(_fitted("tau_e", tau_e, of_tau))
        h = read_only_view(_fitted("h_e", h_e, of_h))
        code, used = answer(layout, fixed, grasp, jacobian, own, shared, e, h, start, question, out)
        if code == _BESIDE and not np.isfinite(dense).all():
            return _NOT_FINITE, used
        if code == _BESIDE:  # a joint moves a finger that it had not moved: seen once
            self._arrange(
                self._moves | np.logical_or.reduceat(dense != 0.0, self.problem.first, axis=0).T
            )
            return self._call(question, G, J, tau_e, h_e, start, out)
        return code, used

    def _arrange(self, moves: BoolArray) -> None:
        self._moves = moves
        self.blocks = find_blocks(self.problem, moves)
        self._inside = pack(self.problem, self.blocks)
        own_at, shared_at = pattern(self.problem, self.blocks)
        self._room = np.empty(len(own_at)), np.empty(shared_at.shape)

    def _asked(
        self, question: int, G: Array, J: Array | HandJacobian, tau_e: Array, h_e: Array,
        start: Array,
    ) -> ForceStep:  # fmt: skip
        out = self._new()
        code, used = self._call(question, G, J, tau_e, h_e, start, out)
        a, b, c, d, _ = self._ends
        phi, total, balance, room, bound = out[d:].tolist()
        status, gap = ForceStatus.SOLVED, np.nan
        if code != _SOLVED:
            status = self._verdict(code, G, J, tau_e, h_e)
        elif question == LEAST:
            gap = (total - bound) / max(total, _FLOOR * float(self._inside.fixed[REST]))
        elif room < self.margin:
            status = ForceStatus.LOW_MARGIN
        return ForceStep(
            status, out[:a], out[c:d], out[a:b], out[b:c], phi, total, used, balance, gap
        )

    def _verdict(
        self, code: int, G: Array, J: Array | HandJacobian, tau_e: Array, h_e: Array
    ) -> ForceStatus:
        if code != _INFEASIBLE:
            return _STATUS[code]
        without, _ = self._call(FRICTION, G, J, tau_e, h_e, _NO_START, self._new())
        strong = without == _SOLVED
        return ForceStatus.INFEASIBLE_TORQUE_LIMITS if strong else ForceStatus.INFEASIBLE_FRICTION


def _fitted(name: str, given: Array, shape: tuple[int, ...]) -> Array:
    """An array as the kernels read it: they trust shape and layout, and compile anew for others."""
    if type(given) is np.ndarray and given.dtype is _DOUBLE and given.shape == shape:
        flags = given.flags
        if flags.c_contiguous and flags.aligned:
            return given
    try:
        values = np.asarray(given)
        if values.dtype.kind not in "fiub":
            raise ValueError
        array = np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise WbcError(f"{name} is not an array of numbers") from None
    if array.shape != shape:
        raise WbcError(f"{name} has shape {array.shape}, expected {shape}")
    return array
